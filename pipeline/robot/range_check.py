"""Range checks of a robot's targets and joints: one check for every source, live or from a file."""

import math
from collections.abc import Mapping, Sequence
from functools import lru_cache, partial
from types import MappingProxyType

import numpy as np

from pipeline.arrays import Floats
from pipeline.robot.config import RobotConfig
from pipeline.robot.coordinates import POSITION_SIZE, turn_of
from pipeline.robot.hands import Hand
from pipeline.robot.recorded import require_recorded_robot
from pipeline.robot.size import SLIDING, chain_length_m, joint_types
from pipeline.rotations import REGULAR_RAD
from recorders.containers.opening import open_log
from recorders.containers.reader import Opened
from recorders.errors import MessageError, OutOfRange
from recorders.messages.message_types import JointState, PoseStamped
from recorders.messages.topics import COMMANDED_TICK, hand_measured, hand_target
from recorders.text.wording import hand_text
from recorders.ticks.joiner import JointMap, PoseReader
from replay.sources.live import LiveLog

MAX_DISTANCE_M = 10.0
"""No target lies farther than this from the middle of the patterns [m], however large the robot."""

_LEAST_DISTANCE_M = 1.0
_LENGTHS = 3.0  # of a robot's chain: no target lies farther off
_MAX_PASSED = 8192  # values remembered to have passed: training takes the same ones hundreds of times
_LENGTH_UNITS = (("millimetres", 1e-3), ("centimetres", 1e-2), ("inches", 0.0254))
_UNIT = 1e-2  # the length of a unit quaternion may differ from 1 by this much: sensors have a resolution
_FULL_TURN = 2.0 * math.pi  # rad: where no joint stands farther from 0, they are no degrees


class RangeCheck:
    """A check that lets pass what can be the robot's, and names the unit that other numbers seem to be in.

    Joints must all be there, and no farther beyond a limit than the limits are apart; joints that the robot does not
    have are not looked at. Targets must be within three lengths of the robot of the middle of its patterns, along each
    axis, and within `MAX_DISTANCE_M`.

    Parameters
    ----------
    robot : RobotConfig
        Whose targets and joints they are.
    """

    def __init__(self, robot: RobotConfig) -> None:
        self._joints = JointMap(robot.joints)
        self._limits = dict(
            zip(robot.joints, zip(robot.lower.tolist(), robot.upper.tolist(), strict=True), strict=True)
        )
        self._types = joint_types(robot)
        self._length_m = chain_length_m(robot)
        self.distance_m = min(max(_LENGTHS * self._length_m, _LEAST_DISTANCE_M), MAX_DISTANCE_M)
        self._hands: list[list[float]] = robot.centres.tolist()
        self._poses = {
            topic: partial(_read_pose, hand)
            for hand in robot.hands
            if hand.orientation is not None
            for topic in (hand_target(hand.name), hand_measured(hand.name))
        }
        self._centre = [sum(axis) / len(self._hands) for axis in zip(*self._hands, strict=True)]
        self._passed: dict[int, Floats | JointState] = {}  # by identity, which holds as long as they are kept

    def __call__(self, value: Floats | JointState) -> None:
        """Check a target, a position [m] (3,) or one with a turn that `poses` has read (6,), or joints.

        Raises
        ------
        JointError
            If a joint of the robot is missing.
        OutOfRange
            If a number cannot be the robot's.
        """
        if self._passed.get(id(value)) is value:
            return
        if isinstance(value, JointState):
            self.check_joints(value)
        else:
            self.check_target(value[:POSITION_SIZE].tolist())
        if len(self._passed) >= _MAX_PASSED:
            self._passed.clear()
        self._passed[id(value)] = value

    def check_target(self, position: Sequence[float]) -> None:
        """Check a target, x, y, z [m]; raises OutOfRange."""
        if not is_within(position, self._centre, self.distance_m):
            found = ", ".join(f"{number:g}" for number in position)
            raise OutOfRange(
                f"expected a target within {self.distance_m:.2g} m of the patterns, found ({found}) m"
                f"{self._unit_of(position)}",
                finite=all(map(math.isfinite, position)),
            )

    @property
    def poses(self) -> Mapping[str, PoseReader]:
        """Readers of the targets, and of the measurements, of hands whose pose is controlled, by topic."""
        return self._poses

    def check_row(self, hand: Hand, row: Sequence[float]) -> None:
        """Check a target of a hand, x, y, z [m], and its orientation if it counts; raises MessageError."""
        self.check_target(row[:POSITION_SIZE])
        if hand.orientation is not None:
            read_turn(hand, np.array(row[POSITION_SIZE:]))

    def margin_m(self, position: Sequence[float]) -> float:
        """Return how far from a position, along every axis, all targets pass [m]; negative if not even the position."""
        margin: float = self.distance_m - max(abs(a - b) for a, b in zip(position, self._centre, strict=True))
        return margin

    def check_joints(self, joints: JointState) -> None:
        """Check the robot's joints among those of a message [rad or m]; raises JointError or OutOfRange."""
        self._joints.positions(joints)  # all there
        found = dict(zip(joints.name, joints.position.tolist(), strict=True))
        for name, (lower, upper) in self._limits.items():
            if not abs(found[name] - (lower + upper) / 2.0) <= 1.5 * (upper - lower):
                raise OutOfRange(
                    f"expected {name} near its limits {lower:g} and {upper:g}, found {found[name]:g}"
                    f"{self._unit_of_joint(name, found)}",
                    finite=math.isfinite(found[name]),
                )

    def check_extent(self, extent_m: float) -> None:
        """Check how far a hand's path reaches to both sides of its middle [m]; raises OutOfRange."""
        if not extent_m <= self._length_m:
            small = extent_m * 1e-2 <= 0.2 * self._length_m
            unit = "centimetres" if small else "millimetres" if extent_m * 1e-3 <= self._length_m else ""
            raise OutOfRange(
                f"expected a path of at most {2.0 * self._length_m:.2g} m across, found {2.0 * extent_m:g} m"
                + (f": looks like {unit}" if unit else ""),
                finite=math.isfinite(extent_m),
            )

    def _unit_of(self, position: Sequence[float]) -> str:
        """Return the unit in which a target would lie near a hand's pattern; empty if in none."""
        near = {
            name: min(math.dist([scale * x for x in position], hand) for hand in self._hands)
            for name, scale in _LENGTH_UNITS
        }
        name = min(near, key=lambda unit: near[unit])
        return f": looks like {name}" if near[name] <= self._length_m / 2.0 else ""

    def _unit_of_joint(self, name: str, found: Mapping[str, float]) -> str:
        """Return the unit in which all joints of one type would be within their limits; empty if in none."""
        slides = self._types.get(name) == SLIDING
        alike = [other for other in self._limits if (self._types.get(other) == SLIDING) == slides]
        if not slides and all(abs(found[other]) <= _FULL_TURN for other in alike):
            return ""
        for unit, scale in _LENGTH_UNITS if slides else (("degrees", math.pi / 180.0),):
            if all(self._is_within(other, scale * found[other]) for other in alike):
                return f": looks like {unit}"
        return ""

    def _is_within(self, name: str, position: float) -> bool:
        lower, upper = self._limits[name]
        return bool(abs(position - (lower + upper) / 2.0) <= 0.6 * (upper - lower))


def read_turn(hand: Hand, orientation: Floats) -> Floats:
    """Return the turn [rad] (3,) of an orientation of a hand whose pose is controlled, a quaternion (4,).

    Raises
    ------
    MessageError
        If it is no unit quaternion.
    OutOfRange
        If it is more than `REGULAR_RAD` from the hand's orientation in the middle.
    """
    length = math.sqrt(sum(number * number for number in orientation.tolist()))
    if not abs(length - 1.0) <= _UNIT:
        raise MessageError(
            f"expected as orientation of {hand_text(hand.name)} a unit quaternion, found length {length:g}"
        )
    turn = turn_of(hand, orientation)
    x, y, z = turn.tolist()
    if not (angle := math.sqrt(x * x + y * y + z * z)) <= REGULAR_RAD:
        raise OutOfRange(
            f"expected {hand_text(hand.name)} within {math.degrees(REGULAR_RAD):.0f} degrees of its orientation in the "
            f"middle, found {math.degrees(angle):.0f}"
        )
    return turn


def _read_pose(hand: Hand, pose: PoseStamped) -> Floats:
    """Return position [m] and turn [rad] of a pose, shape (6,), read-only; raises as `read_turn` does."""
    numbers = np.concatenate([pose.position, read_turn(hand, pose.orientation)])
    numbers.flags.writeable = False
    return numbers


def is_within(position: Sequence[float], centre: Sequence[float], distance_m: float) -> bool:
    """Whether a position is within a distance of a centre along each of three axes [m]; NaN never is."""
    (x, y, z), (x_0, y_0, z_0) = position, centre
    return abs(x - x_0) <= distance_m and abs(y - y_0) <= distance_m and abs(z - z_0) <= distance_m


@lru_cache(maxsize=8)
def range_check(robot: RobotConfig) -> RangeCheck:
    """Return the check of a robot: one for all who ask."""
    return RangeCheck(robot)


def live_log(
    log: Opened,
    *,
    robot: RobotConfig | None = None,
    epochs: int = 1,
    tick: tuple[str, ...] = COMMANDED_TICK,
    renames: Mapping[str, str] = MappingProxyType({}),
) -> LiveLog:
    """Return a recording as `learn --live` would have received it; the robot is the log's if none is given.

    Raises
    ------
    ConfigError
        If there is no robot.
    LogError
        If the log cannot be read, or holds nothing to learn from.
    """
    if robot is None:
        robot = require_recorded_robot(open_log(log), has_option=True)
    check = range_check(robot)
    return LiveLog(log, epochs=epochs, check=check, tick=tick, poses=check.poses, renames=renames)
