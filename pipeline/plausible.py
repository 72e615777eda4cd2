"""What can be a robot's targets and joints: a check for messages that may come from anyone."""

from collections.abc import Callable, Mapping
from types import MappingProxyType

import numpy as np

from pipeline.robot import RobotConfig, parse_robot
from recorders.errors import ConfigError, MessageError
from recorders.fields import FloatArray
from recorders.live_ticks import Check
from recorders.messages import JointState
from recorders.parts import Log
from recorders.session_reader import open_log
from recorders.ticks import JointMap
from replay.engine import read_robot
from replay.live_stream import LiveLog

MAX_DISTANCE_M = 10.0
"""No target lies farther than this from both hands' centres [m]: learning from such numbers would only diverge."""


def plausible(robot: RobotConfig) -> Check:
    """Return a check that lets pass what can be the robot's.

    Joints must all be there, and no farther beyond a limit than the limits are apart; targets must be within
    `MAX_DISTANCE_M`.
    """
    joints = JointMap(robot.joints)
    middle, span = (robot.lower + robot.upper) / 2.0, robot.upper - robot.lower
    centre = (robot.left_centre + robot.right_centre) / 2.0

    def check(value: FloatArray | JointState) -> None:
        if not isinstance(value, JointState):
            if not (np.abs(value - centre) <= MAX_DISTANCE_M).all():
                found = ", ".join(f"{number:g}" for number in value.tolist())
                raise MessageError(f"expected a target within {MAX_DISTANCE_M:g} m of the patterns, found ({found}) m")
            return
        positions = joints.positions(value)
        far = np.flatnonzero(~(np.abs(positions - middle) <= 1.5 * span))
        if len(far):
            place = int(far[0])
            raise MessageError(
                f"expected {robot.joints[place]} near its limits {robot.lower[place]:g} and {robot.upper[place]:g}, "
                f"found {positions[place]:g}"
            )

    return check


def heard_live(
    log: Log,
    *,
    robot: RobotConfig | None = None,
    epochs: int = 1,
    renames: Mapping[str, str] = MappingProxyType({}),
    say: Callable[[str], None] = lambda line: None,
) -> LiveLog:
    """Return a recording as `learn --live` would have heard its messages; the robot is the log's if none is given.

    Raises
    ------
    ConfigError
        If there is no robot.
    LogError
        If the log cannot be read, or holds nothing to learn from.
    """
    if robot is None:
        texts = read_robot(open_log(log))
        if not texts:
            raise ConfigError(f"{log}: expected the robot in the log, found none; give it with --robot")
        robot = parse_robot(texts["toml"], texts["urdf"])
    return LiveLog(log, epochs=epochs, check=plausible(robot), renames=renames, say=say)
