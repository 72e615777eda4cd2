"""A robot that follows commands: checks them, moves by them, and says its state when that is due. No Zenoh."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.backend import VisibleRobot
from pipeline.robot_wire import CommandReader, RobotStatus
from pipeline.telemetry import hand_messages, state_messages
from recorders.errors import ConfigError, MessageError
from recorders.messages import Message

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class FollowerConfig:
    """How a robot follows.

    Parameters
    ----------
    rate_hz : float
        How often it says its state, in its own time [Hz].
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
    """A robot under the commands of whoever sends them.

    Parameters
    ----------
    backend : VisibleRobot
        The robot.
    config : FollowerConfig
        Rate and mode.
    publish : callable
        Takes topic and message: what the robot says.

    Attributes
    ----------
    refused : int
        How many commands were refused, as whoever refuses them counts.
    slipped_s : float
        How far the robot's time has fallen behind the clock on the wall [s], as whoever keeps it counts.
    """

    def __init__(
        self, backend: VisibleRobot, *, config: FollowerConfig, publish: Callable[[str, Message], None]
    ) -> None:
        self._backend = backend
        self._config = config
        self._publish = publish
        self._commands = CommandReader(backend.robot)
        self._held = backend.robot.comfort  # the last command
        self._last_ns = -1  # its stamp, in lockstep
        self._state_due_ns = 0
        self._carried_out = self.refused = 0
        self.slipped_s = 0.0

    def reset(self, data: bytes) -> None:
        """Stand still at the posture of a command, at time 0; raises as `CommandReader.read` does."""
        self.stand(self._commands.read(data)[1])

    def stand(self, posture: Floats) -> None:
        """Stand still at a posture (n,), at time 0."""
        self._backend.reset(posture)
        self._held, self._last_ns = posture, -1
        self._state_due_ns = 0
        self._say_state()

    def follow(self, data: bytes, *, repeats_ns: int) -> None:
        """Take a command: in lockstep, move on by it; in real time, hold it from now on.

        In real time the latest to arrive counts, whatever its stamp: its sender's clock need not be the robot's.

        Parameters
        ----------
        data : bytes
            The command, CDR.
        repeats_ns : int
            A past command that is no older than this [ns] has been carried out before, and comes again.

        Raises
        ------
        MessageError
            If it is no command, or, in lockstep, not one for now.
        JointError
            If it is one for another robot.
        """
        stamp_ns, posture = self._commands.read(data)
        now_ns = self._backend.time_ns
        if self._config.real_time:
            self._held = posture
        elif now_ns - repeats_ns <= stamp_ns < now_ns and self._repeats(stamp_ns, posture):
            return
        elif stamp_ns != now_ns:
            raise MessageError(
                f"expected stamp {now_ns} ns, the robot's time, or the last command again, found stamp {stamp_ns} ns; "
                "is someone else driving it?"
            )
        else:
            self._move(posture)
            self._last_ns, self._held = stamp_ns, posture
        self._carried_out += 1

    def hold(self) -> None:
        """Let one period pass under the latest command."""
        self._move(self._held)

    @property
    def status(self) -> RobotStatus:
        """What there is to be said of the robot."""
        return RobotStatus(
            robot=self._backend.robot.name,
            real_time=self._config.real_time,
            time_ns=self._backend.time_ns,
            period_ns=self._config.period_ns,
            commands=self._carried_out,
            refused=self.refused,
            slipped_s=self.slipped_s,
        )

    def _repeats(self, stamp_ns: int, posture: Floats) -> bool:
        """Whether a past command can have been carried out before: of the last one it is known which it was."""
        return stamp_ns != self._last_ns or np.array_equal(posture, self._held)

    def _move(self, posture: Floats) -> None:
        self._backend.advance(posture, self._config.period_ns)
        self._say_state()

    def _say_state(self) -> None:
        now_ns = self._backend.time_ns
        if now_ns < self._state_due_ns:
            return
        self._state_due_ns += round(1e9 / self._config.rate_hz)
        for messages in (state_messages(self._backend), hand_messages(self._backend)):
            for topic, message in messages:
                self._publish(topic, message)
