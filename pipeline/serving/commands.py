"""Joint commands out of a learner: what it would do next, within the joints' limits, as CDR."""

import struct
from typing import NamedTuple, Self

import numpy as np

from pipeline.arrays import Floats
from pipeline.learner.look_ahead import look_ahead_of
from pipeline.learner.rule import OnlineLearner
from pipeline.robot.config import RobotConfig
from pipeline.serving.output.command_types import CommandFormat, Encode
from pipeline.serving.output.speed_limiter import SpeedLimiter
from recorders.cdr.templates import PositionEncoder
from recorders.messages.record import RecordedMessage


class Command(NamedTuple):
    """One joint command and what it answers.

    Attributes
    ----------
    stamp_ns : int
        Stamp of the targets, and of the command [ns].
    data : bytes
        The command as CDR.
    answered : tuple of RecordedMessage
        The messages of the tick: the targets of the hands and, when learning, the joints.
    """

    stamp_ns: int
    data: bytes
    answered: tuple[RecordedMessage, ...]


class Commander:
    """Encodes the commands of one robot, and counts the joints that its limits held back.

    Parameters
    ----------
    learner : OnlineLearner
        Computes outputs: the last of them are the joints.
    joints : tuple of str
        Names of the n joints, in the order of the outputs.
    limits : ndarray, shape (2, n)
        Lower, then upper limits of the joints [rad, m].
    encode : callable, optional
        Encodes stamp and positions; as JointState if left out.
    limiter : SpeedLimiter, optional
        Keeps the joints from moving too fast.

    Attributes
    ----------
    u : ndarray, shape (inputs,)
        Targets of the last command: positions [m], and turns [rad] where the pose is controlled.
    clipped : ndarray of int64, shape (n,)
        In how many commands a joint was at its limit because the output was beyond.
    """

    def __init__(
        self,
        learner: OnlineLearner,
        joints: tuple[str, ...],
        *,
        limits: Floats,
        encode: Encode | None = None,
        limiter: SpeedLimiter | None = None,
    ) -> None:
        n, look_ahead = len(joints), look_ahead_of(learner)
        self.u = u = np.zeros(learner.config.inputs)
        outputs, self._limited = np.empty(learner.config.outputs), np.empty(n)
        self._targets, self._joints = u.data, outputs[-n:]
        self._fill = struct.Struct(f"={u.size}d").pack_into  # several times as fast as an assignment
        self._look_ahead = look_ahead.bind_look_ahead(u, limits=limits, outputs=outputs, limited=self._limited)
        self._check, self._advance = look_ahead.check, look_ahead.advance
        self._as_joint_state = PositionEncoder(joints).encode
        self._encode, self._limiter = encode or self._as_joint_state, limiter
        self._sent = self._limited
        self.clipped = np.zeros(n, dtype=np.int64)

    @classmethod
    def of_robot(
        cls, learner: OnlineLearner, robot: RobotConfig, commands: CommandFormat, *, limiter: SpeedLimiter | None
    ) -> Self:
        """Return the commands of a robot within its limits, in a format."""
        limits = np.array([robot.lower, robot.upper])
        encode = commands.encoder(robot.joints, least_ns=lambda: limiter.step_ns if limiter else 0)
        return cls(learner, robot.joints, limits=limits, encode=encode, limiter=limiter)

    def command(self, stamp_ns: int, *targets: float) -> bytes:
        """Return the command (CDR) for targets, hand by hand in a row: the outputs of the step that they lead to.

        Raises
        ------
        ConfigError
            If the outputs are not finite.
        RejectionError
            If it is to start from the posture measured, and none was.
        """
        self._compute(targets)
        if self._limiter is not None:
            self._sent = self._limiter.limit(stamp_ns, self._limited)
        return self._encode(stamp_ns, self._sent)

    def warm_up(self, *targets: float) -> None:
        """Do all that a command takes, so that the first one waits for no kernel."""
        self._compute(targets)
        self._encode(0, self._limited)

    def joint_state(self, stamp_ns: int) -> bytes:
        """Return the last command as a JointState (CDR)."""
        return self._as_joint_state(stamp_ns, self._sent)

    def _compute(self, targets: tuple[float, ...]) -> None:
        self._fill(self._targets, 0, *targets)
        if status := self._look_ahead():
            self._check(status)

    def finish(self, *, advance: bool) -> None:
        """Count the joints that were clipped in the last command and, if `advance`, take the step without targets.

        Raises
        ------
        ConfigError
            If the state is no longer finite.
        """
        self.clipped += self._limited != self._joints
        if advance:
            self._advance()
