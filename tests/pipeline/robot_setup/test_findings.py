"""What is wrong with a robot is named with numbers that hold."""

import re
from dataclasses import replace

import numpy as np

from pipeline.robot.config import load_robot
from pipeline.robot_setup.findings import findings


def test_a_centre_far_away_is_no_farther_than_from_the_comfort_posture() -> None:
    """Whatever the arm does on the way to what it cannot reach."""
    robot = load_robot("ur5")
    (hand,) = robot.hands
    far = replace(robot, hands=(replace(hand, centre=np.array([3.0, 0.0, 0.5])),))
    (line,) = findings(far)
    assert line.startswith("hand: expected its centre within reach, found it at (3.00, 0.00, 0.50) m, to which")
    *centre, least_cm, x, y, z = map(float, re.findall(r"-?\d+\.\d+", line))
    assert 100.0 < least_cm <= 100.0 * np.linalg.norm(np.array(centre) - (x, y, z)) + 1.0  # written to the centimetre
