"""What a learner may offer beyond its outputs: how sure its commands are, and the parts that they come from."""

from typing import Protocol, runtime_checkable

from numpy.typing import ArrayLike

from pipeline.arrays import Floats


@runtime_checkable
class KnowsDeviation(Protocol):
    """A learner that knows how far from where they are expected its commands may bring the hands."""

    def deviations(self, u: ArrayLike) -> Floats:
        """Return the standard deviation [m] of each hand, shape (n, hands), after the commands to targets u [m].

        It is infinite before anything was learned. The state stays as it is.
        """

    def usual_deviations(self) -> Floats:
        """Return the deviation [m] of each hand, shape (hands,), as usual among what it has learned from."""


@runtime_checkable
class ShowsParts(Protocol):
    """A learner whose commands come from parts that a viewer can show."""

    def curves(self, u: ArrayLike) -> dict[str, Floats]:
        """Return curves over the commands to targets u (n, inputs) [m], by name and unit, each of shape (n,)."""

    def lines(self) -> tuple[str, ...]:
        """Return a line on each part: its size, and how far it errs."""
