"""Serving in Drake while learning: python tests/benchmarks/bench_serve_learning.py CONTROLLER.npz [PASSES] [MOTION...].

The controller answers circles, eight and the three drawings, each by itself from what it was taught, pass after pass:
`serve --learn` in process, without a network, the simulated robot behind it at 10 Hz. Then the same with joints that
are off by 0.05 rad, of seeds 0 and 1. Of each motion it prints, pass by pass, the mean distance of the hands from
their targets [cm]: where the command leads once the servos have settled, and where the hands are at the end of the hold
of each target, which lag dominates. Nothing is asserted.
"""

import json
import sys
from itertools import pairwise
from pathlib import Path

from pipeline.deployment.learning_passes import PassErrors, serve_passes
from pipeline.evaluation.trials import robot_of
from pipeline.learner.controller import Controller
from pipeline.motions.motion import load_motion
from pipeline.simulation.joint_offset import joint_offsets

MOTIONS = ("circles", "eight", "right_hand_drawing", "right_hand_house", "right_hand_spiral")
OFFSET_RAD = 0.05


def show(name: str, errors: list[PassErrors]) -> None:
    settled = [round(error.settled_cm, 4) for error in errors]
    rises = max((later - earlier for earlier, later in pairwise(settled)), default=0.0)
    print(
        json.dumps(
            {
                "motion": name,
                "pass": {k: settled[k - 1] for k in (1, 2, 5, 20) if k <= len(settled)},
                "largest_rise": round(rises, 4),
                "at_end_of_hold": [round(errors[0].held_cm, 3), round(errors[-1].held_cm, 3)],
            }
        ),
        flush=True,
    )


def main(path: Path, passes: int, motions: tuple[str, ...]) -> None:
    controller = Controller.load(path)
    robot = robot_of(controller)
    for seed in (None, 0, 1):
        print("joints as they are" if seed is None else f"joints off by {OFFSET_RAD} rad, seed {seed}")
        offsets = None if seed is None else joint_offsets(seed, len(robot.joints), largest=OFFSET_RAD)
        for name in motions:
            show(name, serve_passes(controller, load_motion(name, robot), passes=passes, offsets=offsets))


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 20, tuple(sys.argv[3:]) or MOTIONS)
