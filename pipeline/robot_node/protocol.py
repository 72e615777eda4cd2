"""Protocol of a robot node and its driver beside the topics: keys, commands and queries.

One robot stands in a namespace:

- `NAMESPACE/joint_commands`: commands for it, from anyone; it is also what is recorded.
- `NAMESPACE/@robot/command`: a query that carries commands, as `pack_messages` packs them; answered with the joints
  when the last one is over.
- `NAMESPACE/@robot/reset`: a query that carries a posture; the robot stands there at time 0 and answers alike.
- `NAMESPACE/@robot/joints`: a query; answered with the joints as they are.
- `NAMESPACE/@robot/hands`: a query; answered with a PoseStamped of each hand, packed as commands are.
- `NAMESPACE/@robot/status`: a query; answered with a `RobotStatus` as JSON.
- `NAMESPACE/@robot/alive`: a liveliness token; whoever only watches looks at `recorders.nodes.keys`.
- `NAMESPACE/robot_description` and `NAMESPACE/robot_config`: queries for the texts of URDF and TOML, for late joiners.

A command is a JointState that names all joints of the robot, in any order. Its stamp is the robot's time at which it
takes effect; it then holds for one period. A robot in lockstep takes a command only at that very time, and its time
stands still between commands. A command that the robot has carried out may come again, as a query repeats what
came on the topic and as what is lost on the way is sent again: it changes nothing.

Both are published too, once, for subscribers; one with a history gets them whenever it comes, as ROS 2 knows that from
a topic that is transient local. A log that has both carries the robot.
"""

import hashlib
import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Self

import numpy as np

from pipeline.arrays import Floats
from pipeline.robot.config import RobotConfig
from recorders.cdr.codec import decode_as
from recorders.errors import JointError, MessageError, WireError
from recorders.messages.message_types import JointState
from recorders.text.wording import names_text, value_text
from recorders.ticks.joiner import JointMap

MAX_COMMAND = 1 << 16
"""Larger commands, or more than fit in so much together, are refused unread [bytes]; one of 15 joints takes 404."""

_LENGTH = 4  # bytes
_STATUS_TYPES: dict[str, type] = {
    "robot": str,
    "real_time": bool,
    "time_ns": int,
    "period_ns": int,
    "commands": int,
    "refused": int,
    "slipped_s": float,
    "joints": tuple,
}


def robot_key(namespace: str, verb: str) -> str:
    """Return the key of `command`, `reset`, `joints`, `hands`, `status` or `alive`."""
    return f"{namespace}/@robot/{verb}"


def robot_digest(toml: str, urdf: str) -> str:
    """Return the SHA-256 of a robot's two texts, by which a robot and a controller show that they mean the same one."""
    return hashlib.sha256(f"{toml}\0{urdf}".encode()).hexdigest()


def pack_messages(messages: Iterable[bytes]) -> bytes:
    """Return messages as the payload of one query or answer: each behind its length."""
    return b"".join(len(message).to_bytes(_LENGTH, "little") + message for message in messages)


def unpack_messages(payload: bytes) -> list[bytes]:
    """Return the messages of a query or an answer.

    Raises
    ------
    MessageError
        If the payload holds none, or is not what `pack_messages` makes.
    """
    messages: list[bytes] = []
    offset = 0
    while offset < len(payload) or not messages:
        begin = offset + _LENGTH
        length = int.from_bytes(payload[offset:begin], "little")
        offset = begin + length
        if offset > len(payload):
            raise MessageError(f"expected commands behind their lengths, found {len(payload)} bytes that are none")
        messages.append(payload[begin:offset])
    return messages


class CommandReader:
    """Reads commands for one robot, from any sender.

    Parameters
    ----------
    robot : RobotConfig
        The robot.
    """

    def __init__(self, robot: RobotConfig) -> None:
        self._robot = robot
        self._joints = JointMap(robot.joints)

    def read(self, data: bytes) -> tuple[int, Floats]:
        """Return stamp [ns] and posture (n,) of a command, the posture clipped to the joints' limits.

        Raises
        ------
        MessageError
            If the bytes are no JointState, or a position is not finite.
        JointError
            If the joints are not exactly those of the robot.
        """
        joints = decode_as(JointState, data)
        posture = self._joints.positions(joints)
        if len(joints.name) > len(posture):
            strangers = names_text(sorted(set(joints.name) - set(self._robot.joints)))
            raise JointError(f"'{self._robot.name}' has no joint {strangers}; it has {names_text(self._robot.joints)}")
        if not np.isfinite(posture).all():
            index = int(np.flatnonzero(~np.isfinite(posture))[0])
            raise MessageError(
                f"expected a finite position for joint {self._robot.joints[index]}, found {posture[index]}"
            )
        return joints.stamp_ns, np.clip(posture, self._robot.lower, self._robot.upper)


@dataclass(frozen=True)
class RobotStatus:
    """Settings and counts of a robot node.

    Attributes
    ----------
    robot : str
        Name of the robot.
    real_time : bool
        Whether its time runs with the clock on the wall, or waits for commands.
    time_ns : int
        The robot's time [ns].
    period_ns : int
        How long a command holds [ns].
    commands, refused : int
        How many commands it has carried out and refused.
    slipped_s : float
        How far its time has fallen behind the clock on the wall [s].
    joints : tuple of str
        Names of its joints, in order; none if it names none.
    """

    robot: str
    real_time: bool
    time_ns: int
    period_ns: int
    commands: int
    refused: int
    slipped_s: float
    joints: tuple[str, ...] = ()

    def to_json(self) -> bytes:
        """Return the status as JSON."""
        return json.dumps(asdict(self)).encode()

    @classmethod
    def from_json(cls, data: bytes) -> Self:
        """Read a status back; raises WireError if it is not one."""
        try:
            found = json.loads(data)
            status = cls(**found | {"joints": tuple(found.get("joints", ()))})
        except (ValueError, TypeError, AttributeError, RecursionError):
            raise WireError(f"expected the status of a robot, found {value_text(data[:80])}") from None
        for name, kind in _STATUS_TYPES.items():
            if type(getattr(status, name)) is not kind:
                raise WireError(
                    f"status of a robot: found {name} {value_text(getattr(status, name))}, of the wrong type"
                )
        if not all(isinstance(joint, str) for joint in status.joints):
            raise WireError("status of a robot: expected names of joints, found something else")
        if status.period_ns <= 0:
            raise WireError(f"status of a robot: expected a period above 0, found {status.period_ns} ns")
        return status
