"""Wrongly zeroed joints: the robot obeys and measures as if nothing were wrong, and its hands are elsewhere."""

import numpy as np
import pytest

from pipeline.robot.config import load_robot
from pipeline.robot.kinematics import Kinematics
from pipeline.simulation.joint_offset import OffsetRobot, joint_offsets
from pipeline.simulation.simulation import Simulation
from recorders.errors import ConfigError

ROBOT = load_robot("asimo")


def test_offsets_are_fixed_by_their_seed_and_neither_small_nor_too_large() -> None:
    offsets = joint_offsets(3, 200, largest=0.05)
    assert np.array_equal(offsets[:15], joint_offsets(3, 15, largest=0.05))
    assert not np.array_equal(offsets, joint_offsets(4, 200, largest=0.05))
    assert (np.abs(offsets) >= 0.03 - 2.0**-20).all()
    assert (np.abs(offsets) <= 0.05 + 2.0**-20).all()
    assert 0.0 < (offsets < 0.0).mean() < 1.0
    assert np.array_equal(offsets * 2.0**20, np.rint(offsets * 2.0**20))


@pytest.mark.parametrize("largest", [-0.1, 1.5, float("nan")])
def test_an_offset_out_of_range_is_refused(largest: float) -> None:
    with pytest.raises(ConfigError, match="offset"):
        joint_offsets(0, 3, largest=largest)


def test_what_is_measured_is_what_was_commanded_and_the_hands_are_where_they_truly_are() -> None:
    offsets = joint_offsets(0, len(ROBOT.joints), largest=0.05)
    robot, true, kinematics = OffsetRobot(Simulation(ROBOT), offsets), Simulation(ROBOT), Kinematics(ROBOT)
    assert np.allclose(robot.positions, ROBOT.comfort, atol=1e-12)
    target = ROBOT.comfort + 0.01
    robot.advance(target, 200_000_000)
    true.reset(ROBOT.comfort - offsets)
    true.advance(target - offsets, 200_000_000)
    assert robot.time_ns == true.time_ns
    assert np.array_equal(robot.positions, true.positions + offsets)
    assert np.array_equal(robot.hands(), true.hands())
    assert np.linalg.norm(robot.hands() - kinematics.hands(robot.positions), axis=1).max() > 0.005
