"""Outputs before their step: a served controller answers with them, and takes the step once the command is sent."""

from collections.abc import Callable
from typing import Protocol, runtime_checkable

import numpy as np

from pipeline.arrays import Floats
from pipeline.learner.rule import OnlineLearner


@runtime_checkable
class LookAhead(Protocol):
    """A learner's next outputs, apart from its next step.

    A rule whose learner has these methods is served fast: a command then waits for one compiled call on arrays that
    stay the same. Other learners are served all the same, by `look_ahead_of`.
    """

    def bind_look_ahead(self, u: Floats, *, limits: Floats, outputs: Floats, limited: Floats) -> Callable[[], int]:
        """Return a call that computes what `predict` would return of one u, to the bit; the state stays as it is.

        Parameters
        ----------
        u : ndarray of float64, shape (inputs,)
            Read by each call.
        limits : ndarray of float64, shape (2, n)
            Lower, then upper limits of the last n outputs.
        outputs : ndarray of float64, shape (outputs,)
            Filled by each call.
        limited : ndarray of float64, shape (n,)
            Filled by each call with the last n outputs, kept within their limits.

        Returns
        -------
        callable
            Returns 0, or a status for `check`.
        """

    def check(self, status: int) -> None:
        """Raise what a status other than 0 means: MessageError if u is not finite, ConfigError if the outputs are."""

    def advance(self) -> None:
        """Take the step of the last call, to the bit as `predict` does; nothing may have come between.

        Raises ConfigError if the state is no longer finite.
        """


def look_ahead_of(learner: OnlineLearner) -> LookAhead:
    """Return the learner itself if it can look ahead; else what predicts, and goes back to the state before."""
    return learner if isinstance(learner, LookAhead) else _Predicting(learner)


class _Predicting:
    """Looks ahead with any learner, in as much time as copying its state takes."""

    def __init__(self, learner: OnlineLearner) -> None:
        self._learner = learner
        self._u = np.empty((1, learner.config.inputs))

    def bind_look_ahead(self, u: Floats, *, limits: Floats, outputs: Floats, limited: Floats) -> Callable[[], int]:
        """Return a call that predicts, and goes back."""

        def look_ahead() -> int:
            self._u[0] = u
            state = self._learner.state()
            try:
                outputs[:] = self._learner.predict(self._u)[0]
            finally:
                self._learner.load_state(state)
            np.clip(outputs[-limited.size :], *limits, out=limited)
            return 0

        return look_ahead

    def check(self, status: int) -> None:
        """Pass: errors are raised where they happen."""

    def advance(self) -> None:
        """Predict."""
        self._learner.predict(self._u)
