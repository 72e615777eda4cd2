"""Joints move no faster than they may, start from where the robot is, and stop where they are when targets end."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.robot.config import load_robot
from pipeline.serving.output.speed_limiter import FRESH_NS, PAUSE_NS, SpeedLimiter
from pipeline.serving.rejections import Rejection
from recorders.errors import ConfigError, JointError
from recorders.messages.message_types import JointState
from recorders.ticks.stamp_joiner import RejectionError

ROBOT = load_robot("asimo")
COUNT = len(ROBOT.joints)
STEP_NS = 20_000_000


def measured(position: np.ndarray) -> JointState:
    """Return joints in another order, with one more that is not of the robot."""
    return JointState(7, (*ROBOT.joints[::-1], "gripper"), np.append(position[::-1], np.nan))


def limited(limiter: SpeedLimiter, stamp_ns: int, goal: np.ndarray) -> np.ndarray:
    """Return the command for targets that arrive as their stamps say."""
    limiter.now_ns = stamp_ns
    return limiter.limit(stamp_ns, goal)


def started(max_speed: float = 0.5, *, at: np.ndarray = ROBOT.comfort, stamp_ns: int = 0) -> SpeedLimiter:
    limiter = SpeedLimiter(ROBOT, max_speed)
    limiter.measure(measured(at))
    assert limiter.limit(stamp_ns, at + 1.0).tobytes() == at.tobytes()  # the first command moves nothing
    return limiter


def test_without_a_posture_to_start_from_nothing_is_commanded() -> None:
    with pytest.raises(RejectionError) as error:
        SpeedLimiter(ROBOT, 0.5).limit(0, ROBOT.comfort)
    assert error.value.kind is Rejection.NOT_MEASURED


def test_joints_that_are_not_the_robots_are_no_posture_to_start_from() -> None:
    with pytest.raises(JointError, match=ROBOT.joints[0]):
        SpeedLimiter(ROBOT, 0.5).measure(JointState(0, ("other",), np.zeros(1)))


@given(
    goal=st.lists(st.floats(-3.0, 3.0), min_size=COUNT, max_size=COUNT).map(np.array),
    max_speed=st.floats(0.01, 100.0),
    steps=st.lists(st.integers(1, PAUSE_NS), min_size=1, max_size=20),
)
def test_no_joint_is_ever_faster_than_it_may_be(goal: np.ndarray, max_speed: float, steps: list[int]) -> None:
    limiter, stamp, last = started(max_speed), 0, ROBOT.comfort
    allowed = np.minimum(ROBOT.speed_limits, max_speed)
    for step in steps:
        stamp += step
        found = limited(limiter, stamp, goal)
        assert (np.abs(found - last) <= allowed * (limiter.step_ns * 1e-9) * (1 + 1e-9) + 1e-15).all()
        assert (np.abs(found - last) <= allowed * (step * 1e-9) * (1 + 1e-9) + 1e-15).all()
        assert (np.abs(goal - found) <= np.abs(goal - last) + 1e-12).all()  # and never away from where it is to be
        last = found


def test_it_arrives_on_a_straight_line() -> None:
    limiter, goal = started(), ROBOT.comfort + np.linspace(0.05, 0.1, COUNT)
    way = [limited(limiter, k * STEP_NS, goal) for k in range(1, 13)]
    assert way[-1].tobytes() == goal.tobytes()
    assert (np.diff(np.array(way), axis=0)[-1] == 0).all()
    directions = (way[0] - ROBOT.comfort) / (goal - ROBOT.comfort)
    np.testing.assert_allclose(directions, directions[0], rtol=1e-9)


@pytest.mark.parametrize("pause", [True, False])
def test_after_a_pause_or_a_new_cycle_it_starts_from_where_the_robot_is(pause: bool) -> None:
    limiter, elsewhere = started(), ROBOT.comfort + 0.3
    limited(limiter, STEP_NS, ROBOT.comfort + 1.0)
    limiter.measure(measured(elsewhere))
    if not pause:
        limiter.begin()
    stamp = STEP_NS + (PAUSE_NS + 1 if pause else 1)
    assert limiter.limit(stamp, ROBOT.comfort).tobytes() == elsewhere.tobytes()


@pytest.mark.parametrize("max_speed", [0.0, -1.0, float("nan"), float("inf")])
def test_a_speed_that_is_none_is_one_line(max_speed: float) -> None:
    with pytest.raises(ConfigError, match="--max-speed: expected a speed above 0 rad/s"):
        SpeedLimiter(ROBOT, max_speed)


def test_a_posture_that_is_old_is_none_to_start_from() -> None:
    """Whoever moved the arm while its driver was silent gets no jump: not at first, nor after a pause."""
    limiter = SpeedLimiter(ROBOT, 0.5)
    limiter.measure(measured(ROBOT.comfort))
    limiter.now_ns = FRESH_NS + 1
    with pytest.raises(RejectionError, match="within the last second"):
        limiter.limit(0, ROBOT.comfort)
    limiter.measure(measured(ROBOT.comfort))
    limiter.limit(0, ROBOT.comfort)
    limiter.now_ns += FRESH_NS + 1
    with pytest.raises(RejectionError, match="within the last second"):
        limiter.limit(PAUSE_NS + 1, ROBOT.comfort)


def test_targets_that_come_faster_than_their_stamps_say_move_nothing_faster() -> None:
    limiter, goal = started(), ROBOT.comfort + 1.0
    limiter.now_ns = STEP_NS
    found = limiter.limit(4 * STEP_NS, goal)
    assert np.abs(found - ROBOT.comfort).max() <= 0.5 * STEP_NS * 1e-9 * (1 + 1e-9)
    assert limiter.limit(5 * STEP_NS, goal).tobytes() == found.tobytes()  # at the same instant
    assert limiter.limited == 3
