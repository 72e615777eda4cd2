"""A controller that learns while it leads the simulated robot comes nearer, pass by pass; one that does not stays."""

import numpy as np
from small_inverse import ROBOT, taught

from pipeline.deployment.learning_passes import serve_passes
from pipeline.motions.motion import Motion
from pipeline.simulation.joint_offset import joint_offsets


def motion(ticks: int) -> Motion:
    angles = np.linspace(0.0, 2.0 * np.pi, ticks)
    circle = 0.05 * np.stack([0.0 * angles, np.cos(angles), np.sin(angles)], axis=1)
    targets = ROBOT.input_centre.reshape(2, 3) + circle[:, np.newaxis]
    return Motion("circle", np.arange(ticks) * 0.1, targets, closed=True)


def test_joints_that_are_off_are_learned_from_pass_to_pass() -> None:
    offsets = joint_offsets(0, len(ROBOT.joints), largest=0.05)
    learning = [error.settled_cm for error in serve_passes(taught(), motion(16), passes=3, offsets=offsets)]
    still = [error.settled_cm for error in serve_passes(taught(), motion(16), passes=2, offsets=offsets, learn=False)]
    assert learning[2] < learning[1] < learning[0] < still[0]
    assert still[0] == still[1] > 1.0
