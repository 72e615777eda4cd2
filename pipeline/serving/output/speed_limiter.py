"""Speed limit of commanded joints, which starts from where the robot is."""

import math

import numpy as np

from pipeline.arrays import Floats
from pipeline.robot.config import RobotConfig
from pipeline.serving.inputs import JointsReader
from pipeline.serving.rejections import Rejection
from recorders.errors import ConfigError
from recorders.messages.message_types import JointState
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import JOINT_STATES
from recorders.ticks.joiner import JointMap
from recorders.ticks.stamp_joiner import RejectionError

FRESH_NS = 1_000_000_000
"""A posture that came longer ago is none to start from: somebody may have moved the robot since [ns]."""

PAUSE_NS = 1_000_000_000
"""After a pause of the targets longer than this, the next command starts from the posture measured again [ns]."""


class SpeedLimiter:
    """Moves the joints towards each command no faster than they may, along a straight line in joint space.

    The first command is the posture that was measured, so that it moves nothing; so is the first after a pause, as
    somebody may have moved the robot meanwhile. The time for a step is that between the stamps of its targets, or that
    between their arrivals if it is less: targets that come faster than their stamps say move nothing faster. When
    targets end, commands end, and the robot holds the last: a joint stops where it is on its way.

    Parameters
    ----------
    robot : RobotConfig
        The joints, n of them, with limits of their own on how fast they move.
    max_speed : float
        Largest speed of any joint [rad/s, m/s].

    Attributes
    ----------
    step_ns : int
        Least time that the joints may take for the last step [ns].
    limited : int
        How many commands were on the way to where the joints are to be, and not there.
    now_ns : int
        When the last message came, by this machine's clock [ns].

    Raises
    ------
    ConfigError
        If the speed is not above 0.
    """

    def __init__(self, robot: RobotConfig, max_speed: float) -> None:
        check_speed(max_speed)
        self._speeds = np.minimum(robot.speed_limits, max_speed)
        self._joints = JointMap(robot.joints)
        self.now_ns = self.step_ns = self.limited = 0
        self._measured: tuple[int, Floats] | None = None
        self._last: tuple[int, int, Floats] | None = None  # stamp, arrival, command

    def take(self, record: RecordedMessage, reader: JointsReader) -> None:
        """Take note of when a message came, and of the joints if it holds them as measured.

        Raises
        ------
        RejectionError
            If it should, and does not.
        """
        self.now_ns = record.log_time_ns
        if record.topic == JOINT_STATES:
            self.measure(reader.read(record)[1])

    def measure(self, joints: JointState) -> None:
        """Take note of the joints as measured, which came at `now_ns`.

        Raises
        ------
        JointError
            If a joint of the robot is missing.
        """
        self._measured = self.now_ns, self._joints.positions(joints)

    def begin(self) -> None:
        """Start from the posture measured with the next command."""
        self._last = None

    def limit(self, stamp_ns: int, position: Floats) -> Floats:
        """Return what to command at a stamp [ns] on the way to a position [rad, m], shape (n,).

        Raises
        ------
        RejectionError
            If it is to start from the posture measured, and none came within the last second.
        """
        last = self._last
        if last is None or not 0 < stamp_ns - last[0] <= PAUSE_NS:
            if self._measured is None or self.now_ns - self._measured[0] > FRESH_NS:
                raise RejectionError(
                    Rejection.NOT_MEASURED,
                    "/joint_states: expected the joints as measured within the last second, to start from; none came",
                )
            found, self.step_ns = np.array(self._measured[1]), 0
        else:
            allowed_ns = max(0, min(stamp_ns - last[0], self.now_ns - last[1]))
            found = self._step(last[2], position, allowed_ns)
        self.limited += not np.array_equal(found, position)
        self._last = stamp_ns, self.now_ns, found
        return found

    def _step(self, start: Floats, goal: Floats, allowed_ns: int) -> Floats:
        """Return where the joints are after a time, the slowest one deciding for all."""
        way = goal - start
        needed_s = float(np.max(np.abs(way) / self._speeds))
        share = min(1.0, allowed_ns * 1e-9 / needed_s) if needed_s else 1.0
        self.step_ns = math.ceil(share * needed_s * 1e9)
        return np.array(goal) if share == 1.0 else start + share * way


def check_speed(max_speed: float) -> None:
    """Raise ConfigError if a largest speed is not above 0."""
    if not 0.0 < max_speed < np.inf:
        raise ConfigError(f"--max-speed: expected a speed above 0 rad/s, found {max_speed:g}")
