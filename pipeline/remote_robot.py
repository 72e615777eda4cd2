"""A robot across the network, driven as one in this process is."""

import time

import numpy as np
import zenoh
from numpy.typing import ArrayLike, NDArray

from pipeline.kinematics import Kinematics
from pipeline.robot import RobotConfig, parse_robot
from pipeline.robot_wire import RobotStatus, config_key, robot_key
from recorders.cdr import decode_as, encode
from recorders.errors import ConfigError, WireError
from recorders.messages import JointState, String
from recorders.ticks import JointMap
from recorders.topics import ROBOT_DESCRIPTION
from recorders.wire.frames import DEFAULT_NAMESPACE, check_namespace, message_key

Floats = NDArray[np.float64]

_ANSWER_S = 2.0  # how long one answer may take before the question is asked again


class RemoteRobot:
    """The robot node of a namespace. Implements `pipeline.backend.RobotBackend`.

    A command is a query, so that it is asked again if it or its answer is lost. Publishing it on its topic too, before
    `advance`, lets others see it; the robot knows the repeat. `hands` are computed from the joints measured.

    Parameters
    ----------
    session : zenoh.Session
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
        If what it says of itself is not usable.
    """

    def __init__(
        self,
        session: zenoh.Session,
        *,
        namespace: str = DEFAULT_NAMESPACE,
        wait_s: float = 10.0,
        patience_s: float = 10.0,
    ) -> None:
        check_namespace(namespace)
        self._session = session
        self._namespace = namespace
        self._patience_s = wait_s
        self.status = RobotStatus.from_json(self._ask(robot_key(namespace, "status")))
        self._patience_s = patience_s
        self._robot = parse_robot(
            self._ask_text(config_key(namespace)), self._ask_text(message_key(namespace, ROBOT_DESCRIPTION))
        )
        self._kinematics = Kinematics(self._robot)
        self._joints = JointMap(self._robot.joints)
        self._take(self._ask(robot_key(namespace, "joints")))

    @property
    def robot(self) -> RobotConfig:
        """The robot being driven."""
        return self._robot

    @property
    def time_ns(self) -> int:
        """The robot's time since the reset [ns], as it last said."""
        return self._state.stamp_ns

    @property
    def positions(self) -> Floats:
        """Joint positions [rad or m], shape (n,)."""
        return self._positions

    @property
    def velocities(self) -> Floats:
        """Joint velocities [rad/s or m/s], shape (n,)."""
        return self._velocities

    def reset(self, q: ArrayLike) -> None:
        """Stand still at posture `q` (n,), at time 0."""
        self._command("reset", q, stamp_ns=0, expected_ns=0)

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
            self._command("command", q_command, stamp_ns=self.time_ns, expected_ns=self.time_ns + period_ns)

    def hands(self) -> Floats:
        """Positions of both hands [m], left then right, world frame, shape (2, 3)."""
        return self._kinematics.hands(self._positions)

    def _command(self, verb: str, q: ArrayLike, *, stamp_ns: int, expected_ns: int) -> None:
        command = JointState(stamp_ns, self._robot.joints, np.asarray(q, dtype=np.float64))
        self._take(self._ask(robot_key(self._namespace, verb), encode(command)))
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
                if reply.err is not None and reply.err.encoding == zenoh.Encoding.TEXT_PLAIN:
                    raise WireError(f"the robot refused: {reply.err.payload.to_string()}")
            if time.monotonic() > deadline_s:
                raise WireError(
                    f"no robot answered in namespace '{self._namespace}' within {self._patience_s:g} s; "
                    "start one with `reenact robot`, or give its endpoint with --connect"
                )
            time.sleep(0.05)  # nobody there yet: asking is answered at once
