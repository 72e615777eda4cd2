"""Held-out error by the length of a recording: python tests/benchmarks/bench_hold_out.py [--seconds N ...].

Joints at 30 Hz, each going to and fro by 0.25 rad about the comfortable posture, at a pace of its own; hands by the
robot's kinematics, the last fifth left aside as by `train --hold-out 0.2`. Nothing is asserted.
"""

import argparse
import tempfile
from fractions import Fraction
from pathlib import Path

import numpy as np

from pipeline.evaluation.hold_out import held_out_error, split_log
from pipeline.learner.rules.forward_inverse.config import ForwardInverseConfig
from pipeline.robot.config import RobotConfig, load_robot
from pipeline.training.trainer import Trainer, train_on
from recorders.messages.message_types import JointState
from recorders.messages.topics import SAMPLE_JOINTS
from recorders.writing.writer import LogWriter
from replay.sources.schedule import Schedule
from replay.sources.scheduled import Replay

SECONDS = (20, 60, 200, 600)
START_NS, PERIOD_NS = 10**15, 33_333_333
SWING = 0.25  # [rad], or of a sliding joint [m]
RATES_HZ = 0.08 * np.sqrt([2, 3, 5, 7, 11, 13, 17, 19, 23, 29])  # whose joints never come back together
PAIRS = "computed"


def write_log(path: Path, robot: RobotConfig, seconds: int) -> None:
    """Write a recording of the joints."""
    places = np.arange(len(robot.joints))
    attachments = {"robot.urdf": robot.urdf_text.encode(), "robot.toml": robot.toml_text.encode()}
    with LogWriter(path, manifest={"kind": "recording"}, attachments=attachments) as log:
        for tick in range(seconds * 10**9 // PERIOD_NS):
            stamp = START_NS + tick * PERIOD_NS
            angles = 2.0 * np.pi * RATES_HZ[places] * tick * PERIOD_NS * 1e-9 + places
            joints = JointState(stamp, robot.joints, robot.comfort + SWING * np.sin(angles))
            log.write(SAMPLE_JOINTS, joints, log_time_ns=stamp)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robot", default="panda")
    parser.add_argument("--seconds", type=int, nargs="+", default=SECONDS)
    options = parser.parse_args()
    robot = load_robot(options.robot)
    if len(robot.joints) > len(RATES_HZ):
        parser.error(f"expected a robot of at most {len(RATES_HZ)} joints, found {len(robot.joints)}")
    shape = {"inputs": 3 * len(robot.hands), "outputs": len(robot.joints)}
    with tempfile.TemporaryDirectory() as folder:
        for seconds in options.seconds:
            path = Path(folder) / f"{seconds}.mcap"
            write_log(path, robot, seconds)
            learned, aside = split_log(path, Fraction(1, 5), {})
            trainer = Trainer(ForwardInverseConfig(**shape), robot=robot, pairs=PAIRS)
            train_on(Replay([learned], Schedule(epochs=1, topics=(SAMPLE_JOINTS,))), trainer)
            found = held_out_error(trainer.controller(), [aside], robot=robot, pairs=PAIRS, renames={})
            print(f"{seconds:5} s: mean {found['mean_cm']:6.3f} cm, at most {found['max_cm']:6.3f} cm", flush=True)


if __name__ == "__main__":
    main()
