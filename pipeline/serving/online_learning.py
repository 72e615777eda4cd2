"""Learning while serving: each tick completes the step before it, which is scored and learned from."""

from collections import deque
from collections.abc import Callable
from typing import Any

import numpy as np

from pipeline.arrays import Floats
from pipeline.evaluation.errors import hand_errors
from pipeline.learner.rule import OnlineLearner
from pipeline.robot.config import RobotConfig
from pipeline.robot.kinematics import Kinematics
from pipeline.samples.rules.commanded import CommandedPairs
from recorders.messages.record import RecordedMessage
from recorders.ticks.joiner import Tick

_SCORED = 64  # predictions over which the error in the status is taken: half a millisecond of kinematics


class OnlineLearning:
    """Takes the learner's steps with what the ticks teach.

    Parameters
    ----------
    learner : OnlineLearner
        It is changed.
    robot : RobotConfig
        Its joints, in the order of the outputs; its kinematics give the errors of the predictions.

    Attributes
    ----------
    steps : int
        Steps learned from so far.
    """

    def __init__(self, learner: OnlineLearner, robot: RobotConfig) -> None:
        self._learner = learner
        self._pairs = CommandedPairs(robot.joints, len(robot.hands))
        self._u = np.empty((1, learner.config.inputs))  # u(k), d(k) of one step
        self._d = np.empty((1, learner.config.outputs))
        self._kinematics = Kinematics(robot)
        self._scored: deque[tuple[Floats, Floats]] = deque(maxlen=_SCORED)
        self.steps = 0

    @property
    def pending(self) -> Floats:
        """u(k) that waits for its teaching signal [m], shape (3 hands,), or (0,) before the first tick of a cycle."""
        return self._pairs.pending

    def begin(self) -> None:
        """Begin a cycle: nothing is pending."""
        self._pairs.begin()

    def take(self, stamp_ns: int, parts: list[tuple[RecordedMessage, Any]], *, learning: bool) -> None:
        """Take the step that a tick completes: predict, score, then update if `learning`."""
        records, (*hands, joints) = zip(*parts, strict=True)
        tick = Tick(stamp_ns, tuple(map(np.array, hands)), joints, records)
        if self._pairs.fill(tick, self._u[0], self._d[0]):
            outputs = self._learner.step(self._u, self._d, learning=learning)
            self._scored.append((self._u[0].copy(), outputs[0, self._u.size :]))
            self.steps += learning

    def error_later(self) -> Callable[[], float | None]:
        """Return a function that computes the mean error of the last predictions that met their d [cm], eq. (10)."""
        scored = tuple(self._scored)

        def error_cm() -> float | None:
            if not scored:
                return None
            targets, postures = (np.array(column) for column in zip(*scored, strict=True))
            return float(hand_errors(self._kinematics, postures, targets).mean() * 100.0)

        return error_cm
