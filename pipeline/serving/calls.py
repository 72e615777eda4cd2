"""Calls that answer a served controller's targets: compiled for the rules that have such, general for all others."""

from collections.abc import Callable
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from pipeline.learner.rule import OnlineLearner
from pipeline.serving.codec import CommandEncoder
from pipeline.serving.compiled_calls import ServingCalls

Floats = NDArray[np.float64]

_UNUSUAL, _OK = -1, 0


class Calls(Protocol):
    """Calls on a learner that is served.

    Attributes
    ----------
    u : ndarray, shape (inputs,)
        Targets of the last command [m]; to be set before `look_ahead`.
    clipped : ndarray of int64, shape (n,)
        In how many commands a joint was at its limit because the output was beyond.
    """

    u: Floats
    clipped: NDArray[np.int64]

    def answer(self, left: bytes, right: bytes, after_ns: int) -> int:
        """Return the stamp [ns] of two poses (CDR) whose command is encoded, or -1 for `look_ahead` to do it."""

    def look_ahead(self) -> None:
        """Write the outputs of a step with `u`, within the joints' limits, to the encoder; the state stays."""

    def settle(self, *, advance: bool) -> int:
        """Count clipped joints, and take the step without targets if asked to; returns a status for `check`."""

    def check(self, status: int) -> None:
        """Raise what a status other than 0 means."""


class GeneralCalls:
    """Calls by the methods of `OnlineLearner` alone; parameters as for `ServingCalls`."""

    def __init__(
        self, learner: OnlineLearner, encoder: CommandEncoder, *, limits: Floats, centres: Floats, near_m: float
    ) -> None:
        self._learner, self._limits, self._limited = learner, limits, encoder.positions
        self.u, self._outputs = np.array(centres), np.empty(learner.config.outputs)
        self.clipped = np.zeros(encoder.positions.size, dtype=np.int64)

    def answer(self, left: bytes, right: bytes, after_ns: int) -> int:
        """Leave all messages to the general path."""
        return _UNUSUAL

    def look_ahead(self) -> None:
        """Look one step ahead, and go back."""
        state = self._learner.state()
        try:
            self._outputs[:] = self._learner.predict(self.u[np.newaxis])[0]
        finally:
            self._learner.load_state(state)
        np.clip(self._joints, *self._limits, out=self._limited)

    def settle(self, *, advance: bool) -> int:
        """Count, and take the step."""
        self.clipped += self._limited != self._joints
        if advance:
            self._learner.predict(self.u[np.newaxis])
        return _OK

    def check(self, status: int) -> None:
        """Pass: errors are raised where they happen."""

    @property
    def _joints(self) -> Floats:
        return self._outputs[-self._limited.size :]


_COMPILED: dict[str, Callable[..., Calls]] = {"reservoir": ServingCalls}


def serving_calls(
    learner: OnlineLearner, encoder: CommandEncoder, *, limits: Floats, centres: Floats, near_m: float
) -> Calls:
    """Return the fastest calls that there are for a learner's rule; parameters as for `ServingCalls`."""
    make = _COMPILED.get(learner.config.rule, GeneralCalls)
    return make(learner, encoder, limits=limits, centres=centres, near_m=near_m)
