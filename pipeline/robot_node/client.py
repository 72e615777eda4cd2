"""A robot across the network, driven as one in this process is."""

import time

import numpy as np
from numpy.typing import ArrayLike

from pipeline.arrays import Floats
from pipeline.robot.config import RobotConfig, parse_robot
from pipeline.robot.coordinates import row_size
from pipeline.robot_node.protocol import MAX_COMMAND, RobotStatus, pack_messages, robot_key, unpack_messages
from recorders.cdr.codec import decode_as, encode
from recorders.errors import ConfigError, WireError
from recorders.messages.message_types import JointState, PoseStamped, String
from recorders.messages.topics import ROBOT_TEXTS
from recorders.ticks.joiner import JointMap
from recorders.wire.keys.namespace import DEFAULT_NAMESPACE, check_namespace, message_key
from recorders.wire.session import Session

_ANSWER_S = 2.0  # how long one answer may take before the question is asked again


class RemoteRobot:
    """The robot node of a namespace. Implements `pipeline.robot.backend.RobotBackend`.

    Commands travel in a query, so that they are asked again if they or the answer are lost. In lockstep the robot's
    time after a command is known: commands wait here and go out together, when somebody reads what was measured, when
    they fill a query, or with `wait`. Publishing a command on its topic too, before `advance`, lets others see it and
    the robot begin; it knows the repeat. `hands` are computed from the joints measured.

    Parameters
    ----------
    session : Session
        An open session.
    namespace : str
        First part of every key.
    wait_s : float
        How long the robot may take to appear [s].
    patience_s : float
        How long it may then leave a question unanswered [s].

    Raises
    ------
    WireError
        If no robot answers; from every method that asks it, also if it refuses or answers something else.
    RobotError
        If its description or status is not usable.
    """

    def __init__(
        self,
        session: Session,
        *,
        namespace: str = DEFAULT_NAMESPACE,
        wait_s: float = 10.0,
        patience_s: float = 10.0,
    ) -> None:
        check_namespace(namespace)
        self._session = session
        self._namespace = namespace
        self._patience_s = wait_s
        self._waiting: list[bytes] = []  # commands that the robot has not been asked for yet
        self._name = ""  # until it has answered
        self.status = RobotStatus.from_json(self._ask(robot_key(namespace, "status")))
        self._patience_s = patience_s
        self._robot = parse_robot(
            *(self._ask_text(message_key(namespace, ROBOT_TEXTS[text])) for text in ("toml", "urdf")),
            origin=f"the robot in namespace {namespace}",
        )
        self._joints = JointMap(self._robot.joints)
        self._take(self._ask(robot_key(namespace, "joints")))
        self._name = self._robot.name

    @property
    def robot(self) -> RobotConfig:
        """The robot being driven."""
        return self._robot

    @property
    def time_ns(self) -> int:
        """The robot's time since the reset [ns], at the end of all commands."""
        return self._state.stamp_ns + len(self._waiting) * self.status.period_ns

    @property
    def positions(self) -> Floats:
        """Joint positions [rad or m], shape (n,)."""
        self.wait()
        return self._positions

    @property
    def velocities(self) -> Floats:
        """Joint velocities [rad/s or m/s], shape (n,)."""
        self.wait()
        return self._velocities

    def reset(self, q: ArrayLike) -> None:
        """Stand still at posture `q` (n,), at time 0."""
        self.wait()
        self._request_move("reset", self._command(q, stamp_ns=0), expected_ns=0)

    def advance(self, q_command: ArrayLike, duration_ns: int) -> None:
        """Command posture `q_command` (n,) and let `duration_ns` pass, a multiple of the robot's period.

        Raises
        ------
        ConfigError
            `duration_ns` is not a multiple of the robot's period.
        """
        period_ns = self.status.period_ns
        if duration_ns < 0 or duration_ns % period_ns:
            raise ConfigError(
                f"robot '{self._robot.name}' holds a command for {period_ns} ns: expected a duration in multiples of "
                f"that, found {duration_ns} ns"
            )
        for _ in range(duration_ns // period_ns):
            command = self._command(q_command, stamp_ns=self.time_ns)
            self._waiting.append(command)
            # Now, and not before the next command: its topic may bring that one first, and the robot is further then.
            full = (len(self._waiting) + 1) * len(pack_messages([command])) > MAX_COMMAND
            if full or self.status.real_time:
                self.wait()

    def wait(self) -> None:
        """Wait until the robot has carried out every command."""
        if self._waiting:
            commands, expected_ns = pack_messages(self._waiting), self.time_ns
            self._waiting = []
            self._request_move("command", commands, expected_ns=expected_ns)

    def hands(self) -> Floats:
        """Hands by row, world frame, shape (hands, row size): positions [m], and orientations where one counts."""
        self.wait()
        poses = unpack_messages(self._ask(robot_key(self._namespace, "hands")))
        if len(poses) != len(self._robot.hands):
            raise WireError(f"robot '{self._robot.name}': expected {len(self._robot.hands)} hands, found {len(poses)}")
        found = (decode_as(PoseStamped, pose) for pose in poses)
        return np.array([[*pose.position, *pose.orientation][: row_size(self._robot)] for pose in found])

    def _command(self, q: ArrayLike, *, stamp_ns: int) -> bytes:
        return encode(JointState(stamp_ns, self._robot.joints, np.asarray(q, dtype=np.float64)))

    def _request_move(self, verb: str, payload: bytes, *, expected_ns: int) -> None:
        """Send a move to the robot and check that the time in its answer is `expected_ns`."""
        self._take(self._ask(robot_key(self._namespace, verb), payload))
        late = self.status.real_time and self.time_ns > expected_ns
        if self.time_ns != expected_ns and not late:
            raise WireError(
                f"robot '{self._robot.name}': expected its time to be {expected_ns} ns, found {self.time_ns} ns; "
                "is someone else driving it?"
            )

    def _take(self, answer: bytes) -> None:
        """Take the robot's word for where it is."""
        self._state = decode_as(JointState, answer)
        self._positions = self._joints.positions(self._state)
        speeds = JointState(self._state.stamp_ns, self._state.name, self._state.velocity)
        self._velocities = self._joints.positions(speeds)

    def _ask_text(self, key: str) -> str:
        return decode_as(String, self._ask(key)).data

    def _ask(self, key: str, payload: bytes = b"") -> bytes:
        """Ask until there is an answer, and return it."""
        deadline_s = time.monotonic() + self._patience_s
        while True:
            for reply in self._session.get(key, payload=payload, timeout=_ANSWER_S):
                if reply.ok is not None:
                    return reply.ok.payload.to_bytes()
                if reply.err is not None and str(reply.err.encoding) == "text/plain":
                    raise WireError(f"the robot refused: {reply.err.payload.to_string()}")
            if time.monotonic() > deadline_s:
                raise WireError(self._silence())
            time.sleep(0.05)  # nobody there yet: asking is answered at once

    def _silence(self) -> str:
        if self._name:
            return (
                f"robot '{self._name}' has not answered for {self._patience_s:g} s; what it was sent after its time "
                f"{self._state.stamp_ns} ns is unconfirmed; was it stopped, or the connection cut?"
            )
        return (
            f"no robot answered in namespace '{self._namespace}' within {self._patience_s:g} s; "
            "start one with `reenact robot`, or give its endpoint with --connect"
        )
