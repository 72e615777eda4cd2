"""Predicted deviations of a served controller's commands, and which targets are beyond what was explored."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from pipeline.arrays import Floats
from pipeline.learner.insight import KnowsDeviation
from pipeline.serving.rejections import Rejection
from recorders.ticks.stamp_joiner import RejectionError

BEYOND = 3.0
"""A target is beyond what was explored where its deviation is so many times what is usual among what was learned."""

_CM_PER_M = 100.0


class Deviations:
    """Keeps account of the deviations that a learner expects of its commands.

    A deviation grows with the distance from what the learner has learned from. While nothing was learned, all is
    beyond.

    Parameters
    ----------
    learner : KnowsDeviation
        Expects them.
    hands : tuple of str
        Names of its hands.
    report : callable
        Takes a line on the first targets beyond what was explored.
    on_deviation : callable
        Takes stamp [ns] and deviations [m] of each command.

    Attributes
    ----------
    beyond : int
        Targets beyond what was explored so far.
    """

    def __init__(
        self,
        learner: KnowsDeviation,
        hands: tuple[str, ...],
        *,
        report: Callable[[str], None],
        on_deviation: Callable[[int, Floats], None],
    ) -> None:
        self._learner, self._hands = learner, hands
        self._report, self._on_deviation = report, on_deviation
        self._bounds: Floats | None = None
        self.beyond = self._count = 0
        self._last, self._sum, self._largest = np.full((3, len(hands)), 0.0)

    def learned(self) -> None:
        """Note that the learner has learned."""
        self._bounds = None

    def account(self, stamp_ns: int, targets: Floats) -> None:
        """Take account of the command to targets [m], shape (inputs,), once it is sent."""
        deviations = self._expect(targets)
        self._count += 1
        self._last, self._sum = deviations, self._sum + deviations
        self._largest = np.maximum(self._largest, deviations)
        if self._is_beyond(deviations):
            self.beyond += 1
            if self.beyond == 1:
                self._report(f"at {stamp_ns} ns, {self._line(deviations)}")
        self._on_deviation(stamp_ns, deviations)

    def refuse_beyond(self, stamp_ns: int, targets: Floats) -> None:
        """Raise RejectionError if targets [m], shape (inputs,), are beyond what was explored; they are counted then."""
        deviations = self._expect(targets)
        if self._is_beyond(deviations):
            self.beyond += 1
            raise RejectionError(Rejection.BEYOND, f"at {stamp_ns} ns, {self._line(deviations)}")

    def summary(self) -> dict[str, Any]:
        """Return the last, the mean and the largest deviation of each hand [cm], and what was beyond, as JSON has it.

        Deviations are left out before the first command, and where nothing was learned yet.
        """
        shown = {"deviation_cm": self._last, "deviation_mean_cm": self._sum / max(self._count, 1)}
        shown["deviation_max_cm"] = self._largest
        known = {
            name: dict(zip(self._hands, (values * _CM_PER_M).tolist(), strict=True))
            for name, values in shown.items()
            if self._count and np.isfinite(values).all()
        }
        return {"beyond": self.beyond, **known}

    def text(self) -> str:
        """Return the larger deviation of the last command as a text, empty where there is none; from any thread."""
        largest = float(self._last.max())
        return f", deviation {largest * _CM_PER_M:.2g} cm" if 0.0 < largest < math.inf else ""

    def _expect(self, targets: Floats) -> Floats:
        deviations: Floats = self._learner.deviations(targets[np.newaxis])[0]
        return deviations

    def _is_beyond(self, deviations: Floats) -> bool:
        if self._bounds is None:
            self._bounds = BEYOND * self._learner.usual_deviations()
        return not ((deviations <= self._bounds) & np.isfinite(self._bounds)).all()

    def _line(self, deviations: Floats) -> str:
        expected = ", ".join(
            f"{hand} {_CM_PER_M * deviation:.2g}" for hand, deviation in zip(self._hands, deviations, strict=True)
        )
        return (
            f"targets beyond what was explored: the deviation expected of the hands, {expected} cm, is more than "
            f"{BEYOND:g} times that where the controller was taught; so far from there they may be off by far more"
        )
