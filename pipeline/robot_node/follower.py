"""Robot that follows commands: checks them, moves by them, and publishes its state when that is due. No Zenoh."""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pipeline.arrays import Floats
from pipeline.robot.backend import LinkPoseSource
from pipeline.robot.telemetry import hand_messages, state_messages
from pipeline.robot_node.protocol import CommandReader, RobotStatus
from recorders.errors import ConfigError, MessageError
from recorders.messages.message_types import Message

_REMEMBERED = 2048  # commands; twice what a sender by default has under way, and so may send again


@dataclass(frozen=True)
class FollowerConfig:
    """Settings of a robot that follows commands.

    Parameters
    ----------
    rate_hz : float
        How often it publishes its state, in its own time [Hz].
    real_time : bool
        Whether its time runs with the clock on the wall, the latest command holding; else lockstep: every command
        moves it on by one period, and its time stands still between commands.
    period_ns : int
        How long a command holds [ns]; a multiple of the simulation's control period.

    Raises
    ------
    ConfigError
        If a number is out of range.
    """

    rate_hz: float = 50.0
    real_time: bool = False
    period_ns: int = 5_000_000

    def __post_init__(self) -> None:
        """Check ranges."""
        if self.period_ns <= 0:
            raise ConfigError(f"period: expected above 0 ns, found {self.period_ns}")
        if not 0.01 <= self.rate_hz <= 1e9 / self.period_ns:
            raise ConfigError(f"rate: expected 0.01 to {1e9 / self.period_ns:g} Hz, found {self.rate_hz:g}")


class Follower:
    """Robot under the commands of any sender.

    Parameters
    ----------
    backend : LinkPoseSource
        The robot.
    config : FollowerConfig
        Rate and mode.
    publish : callable
        Takes topic and message of what the robot publishes.

    Attributes
    ----------
    refused : int
        How many commands were refused, as whoever refuses them counts.
    slipped_s : float
        How far the robot's time has fallen behind the clock on the wall [s], as whoever keeps it counts.
    """

    def __init__(
        self, backend: LinkPoseSource, *, config: FollowerConfig, publish: Callable[[str, Message], None]
    ) -> None:
        self._backend = backend
        self._config = config
        self._publish = publish
        self._commands = CommandReader(backend.robot)
        self._held = backend.robot.comfort  # the last command
        self._done: deque[Floats] = deque(maxlen=_REMEMBERED)  # the last commands, in lockstep one for each period
        self._state_due_ns = 0
        self._carried_out = self.refused = 0
        self.slipped_s = 0.0

    def reset(self, data: bytes) -> None:
        """Stand still at the posture of a command, at time 0; raises as `CommandReader.read` does."""
        self.stand(self._commands.read(data)[1])

    def stand(self, posture: Floats) -> None:
        """Stand still at a posture (n,), at time 0."""
        self._backend.reset(posture)
        self._held = posture
        self._done.clear()
        self._state_due_ns = 0
        self._publish_state()

    def follow(self, data: bytes) -> None:
        """Take a command: in lockstep, move on by it; in real time, hold it from now on.

        A command that comes again changes nothing. In real time the latest to arrive counts, whatever its stamp: its
        sender's clock need not be the robot's.

        Raises
        ------
        MessageError
            If it is no command, or, in lockstep, neither one for now nor one of the last again.
        JointError
            If it is one for another robot.
        """
        stamp_ns, posture = self._commands.read(data)
        if not self._config.real_time:
            if self._is_done(stamp_ns, posture):
                return
            self._check_due(stamp_ns)
            self._move(posture)
            self._done.append(posture)
        self._held = posture
        self._carried_out += 1

    def hold(self) -> None:
        """Let one period pass under the latest command."""
        self._move(self._held)

    @property
    def status(self) -> RobotStatus:
        """Status of the robot."""
        return RobotStatus(
            robot=self._backend.robot.name,
            real_time=self._config.real_time,
            time_ns=self._backend.time_ns,
            period_ns=self._config.period_ns,
            commands=self._carried_out,
            refused=self.refused,
            slipped_s=self.slipped_s,
            joints=self._backend.robot.joints,
        )

    def _is_done(self, stamp_ns: int, posture: Floats) -> bool:
        """Return whether a command repeats one of the last that were carried out."""
        periods, rest = divmod(self._backend.time_ns - stamp_ns, self._config.period_ns)
        return rest == 0 and 1 <= periods <= len(self._done) and np.array_equal(self._done[-periods], posture)

    def _check_due(self, stamp_ns: int) -> None:
        if stamp_ns != self._backend.time_ns:
            raise MessageError(
                f"expected stamp {self._backend.time_ns} ns, the robot's time, or one of the last commands again, "
                f"found stamp {stamp_ns} ns; is someone else driving it? For a controller's "
                "commands, with stamps of their own, start the robot with --real-time"
            )

    def _move(self, posture: Floats) -> None:
        self._backend.advance(posture, self._config.period_ns)
        self._publish_state()

    def _publish_state(self) -> None:
        now_ns = self._backend.time_ns
        if now_ns < self._state_due_ns:
            return
        self._state_due_ns += round(1e9 / self._config.rate_hz)
        for messages in (state_messages(self._backend), hand_messages(self._backend)):
            for topic, message in messages:
                self._publish(topic, message)
