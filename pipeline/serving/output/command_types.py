"""Message types of joint commands: what a robot's own controllers subscribe to."""

import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from pipeline.arrays import Floats
from recorders.cdr.layouts import write_message
from recorders.cdr.stream import ENCAPSULATION
from recorders.cdr.templates import PositionEncoder
from recorders.cdr.types.joint_trajectory import JointTrajectory, TrajectoryPoint
from recorders.errors import ConfigError
from recorders.messages.message_types import Float64MultiArray, JointState, TypedMessage
from recorders.messages.topics import JOINT_COMMANDS
from recorders.text.wording import names_text

REACH_IN_S = 0.1
"""In what time the point of a trajectory is to be reached, if nothing else is asked for [s]."""

_LONGEST_S = 3600.0
_SECOND = 10**9
_DURATION = struct.Struct("<iI")  # s and ns, the last of a trajectory's point

Encode = Callable[[int, Floats], bytes]
"""Returns the payload (CDR) of a stamp [ns] and joint positions [rad, m], shape (n,)."""


class CommandType(StrEnum):
    """Type of the messages that command the joints."""

    JOINT_STATE = "joint-state"
    TRAJECTORY = "trajectory"
    FLOAT64_ARRAY = "float64-array"


_TOPICS: dict[str, tuple[str, str]] = {
    CommandType.JOINT_STATE: (JOINT_COMMANDS, JointState.TYPE),
    CommandType.TRAJECTORY: ("/joint_trajectory_controller/joint_trajectory", JointTrajectory.TYPE),
    CommandType.FLOAT64_ARRAY: ("/forward_position_controller/commands", Float64MultiArray.TYPE),
}


@dataclass(frozen=True)
class CommandFormat:
    """Type and topic of commands.

    Parameters
    ----------
    type : str
        `trajectory` and `float64-array` are what ros2_control's joint trajectory controller and forward position
        controller take. Neither carries a stamp: a trajectory stamped 0 begins at once, whatever the clocks are.
    topic : str, optional
        Where they are published; the one on which that controller subscribes if left out.
    reach_in_s : float, optional
        In what time the one point of a trajectory is to be reached [s], unless joints that may move no faster take
        longer; `REACH_IN_S` if left out.

    Raises
    ------
    ConfigError
        If the type is unknown, the topic is none, or the time is not above 0 or is of no use to the type.
    """

    type: str = CommandType.JOINT_STATE
    topic: str = ""
    reach_in_s: float | None = None

    def __post_init__(self) -> None:
        if self.type not in _TOPICS:
            raise ConfigError(f"--command-type: expected {names_text(_TOPICS)}, found {self.type!r}")
        topic, _ = _TOPICS[self.type]
        if self.topic and not self.topic.startswith("/"):
            raise ConfigError(f"--command-topic: expected a topic such as {topic}, found {self.topic!r}")
        if self.reach_in_s is not None and self.type != CommandType.TRAJECTORY:
            raise ConfigError(f"--reach-in: expected --command-type {CommandType.TRAJECTORY}, found {self.type}")
        if self.reach_in_s is not None and not 1e-9 <= self.reach_in_s < _LONGEST_S:
            raise ConfigError(f"--reach-in: expected a time above 0 s, found {self.reach_in_s:g}")
        object.__setattr__(self, "topic", self.topic or topic)

    @property
    def type_name(self) -> str:
        """ROS 2 name of the message type."""
        return _TOPICS[self.type][1]

    def encoder(self, joints: tuple[str, ...], *, least_ns: Callable[[], int] = lambda: 0) -> Encode:
        """Return what encodes the positions of these joints, in their order.

        Parameters
        ----------
        joints : tuple of str
            Their names.
        least_ns : callable
            Returns the least time in which the positions of the command under way may be reached [ns].
        """
        if self.type == CommandType.JOINT_STATE:
            return PositionEncoder(joints).encode
        fill = _filled_in(self._message(joints))
        if self.type == CommandType.FLOAT64_ARRAY:
            return lambda stamp_ns, position: fill(position)
        reach_in_ns = self._reach_in_ns
        return lambda stamp_ns, position: (
            fill(position)[: -_DURATION.size] + _DURATION.pack(*divmod(max(reach_in_ns, least_ns()), _SECOND))
        )

    @property
    def _reach_in_ns(self) -> int:
        return round((self.reach_in_s or REACH_IN_S) * _SECOND)

    def _message(self, joints: Sequence[str]) -> TypedMessage:
        """Return a command of this type, with the joints at 0."""
        zeros = np.zeros(len(joints))
        if self.type == CommandType.FLOAT64_ARRAY:
            return Float64MultiArray(zeros)
        return JointTrajectory(0, tuple(joints), (TrajectoryPoint(self._reach_in_ns, zeros),))


def _filled_in(message: TypedMessage) -> Callable[[Floats], bytes]:
    """Return what puts positions in place of the first run of numbers of a message."""
    written = write_message(message)
    start, end = written.runs[0]
    payload = written.payload()
    head, tail = payload[: len(ENCAPSULATION) + start], payload[len(ENCAPSULATION) + end :]
    return lambda position: head + position.tobytes() + tail
