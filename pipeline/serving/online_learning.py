"""Learning while serving: the learner's steps, each scored and learned from once its tick has come."""

from collections import deque
from collections.abc import Callable
from typing import Any

import numpy as np

from pipeline.arrays import Floats
from pipeline.evaluation.errors import hand_errors
from pipeline.learner.rule import OnlineLearner
from pipeline.robot.config import RobotConfig
from pipeline.robot.kinematics import Kinematics
from pipeline.samples.pairing import COMMANDED, PairingRule
from recorders.messages.record import RecordedMessage
from recorders.ticks.joiner import Tick, joints_rank

_SCORED = 64  # predictions over which the error in the status is taken: half a millisecond of kinematics


class OnlineLearning:
    """Takes the learner's steps with what the ticks teach.

    Parameters
    ----------
    learner : OnlineLearner
        It is changed.
    robot : RobotConfig
        Its joints, in the order of the outputs; its kinematics give the errors of the predictions.
    pairing : PairingRule
        Makes steps of ticks.

    Attributes
    ----------
    pairing : PairingRule
        The rule that is followed.
    steps : int
        Steps learned from so far.
    """

    def __init__(self, learner: OnlineLearner, robot: RobotConfig, pairing: PairingRule) -> None:
        self._learner, self._robot = learner, robot
        self.follow(pairing)
        self._u = np.empty((1, learner.config.inputs))  # u(k), d(k) of one step
        self._d = np.empty((1, learner.config.outputs))
        self._kinematics = Kinematics(robot)
        self._scored: deque[tuple[Floats, Floats]] = deque(maxlen=_SCORED)
        self.steps = 0

    def follow(self, pairing: PairingRule) -> None:
        """Make steps by a rule from now on."""
        self.pairing = pairing
        self._pairs = pairing.pairs(self._robot)
        self._joints = joints_rank(pairing.topics(self._robot.hand_names))
        self._scores = pairing.name == COMMANDED  # with others no command is an answer to the u that is learned

    @property
    def pending(self) -> Floats:
        """u(k) that waits for its teaching signal [m], shape (3 hands,), or (0,) if none does."""
        return self._pairs.pending

    def begin(self) -> None:
        """Begin a cycle: nothing is pending."""
        self._pairs.begin()

    def take(self, stamp_ns: int, parts: list[tuple[RecordedMessage, Any]], *, learning: bool) -> bool:
        """Take the step that a tick completes: predict, score, then update if `learning`; returns if it has learned."""
        records, values = zip(*parts, strict=True)
        hands = tuple(np.array(value) for rank, value in enumerate(values) if rank != self._joints)
        if not self._pairs.fill(Tick(stamp_ns, hands, values[self._joints], records), self._u[0], self._d[0]):
            return False
        outputs = self._learner.step(self._u, self._d, learning=learning)
        if self._scores:
            self._scored.append((self._u[0].copy(), outputs[0, self._u.size :]))
        self.steps += learning
        return learning

    def error_later(self) -> Callable[[], float | None]:
        """Return a function that computes the mean error of the last predictions that met their d [cm], eq. (10)."""
        scored = tuple(self._scored)

        def error_cm() -> float | None:
            if not scored:
                return None
            targets, postures = (np.array(column) for column in zip(*scored, strict=True))
            return float(hand_errors(self._kinematics, postures, targets).mean() * 100.0)

        return error_cm
