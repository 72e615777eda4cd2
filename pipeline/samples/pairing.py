"""The seam for pairing rules: which topics make a tick, and how ticks become the steps that a learner takes.

A rule is a module with `RULE`, a `PairingRule`: here in `pipeline.samples.rules`, named as the rule is, or in a
distribution of others, under an entry point of the group `reenact.pairs`. `pipeline.samples.contract` has tests for it.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

from pipeline.arrays import Floats
from pipeline.samples import rules
from recorders.registry import Registry
from recorders.ticks.joiner import Tick, check_tick_topics

COMMANDED = "commanded"
"""The paper's rule, of controllers that name none."""


class Pairs(Protocol):
    """Turns the ticks of a cycle into steps: an input u and what it is taught, d = (hand positions; joints).

    Made as `PairingRule.pairs(joints, hands)`: of the joints in the order of the outputs, and so many hands.
    """

    @property
    def pending(self) -> Floats:
        """The input that waits for its teaching signal [m], shape (3 hands,), or (0,) if none does."""

    @property
    def stamp_ns(self) -> int:
        """Stamp of the input of the step that was completed last [ns]."""

    def resume(self, pending: Floats) -> None:
        """Go on from what was pending, shape (3 hands,) or (0,)."""

    def begin(self) -> None:
        """Start a cycle: nothing is pending."""

    def fill(self, tick: Tick, u: Floats, d: Floats) -> bool:
        """Take the next tick of the cycle.

        Parameters
        ----------
        tick : Tick
            Hands and joints, on the topics of the rule.
        u : ndarray, shape (3 hands,)
            Takes the input of the step that is complete now [m].
        d : ndarray, shape (3 hands + n,)
            Takes its teaching signal: hand positions [m], joints [rad or m].

        Returns
        -------
        bool
            Whether a step is complete.

        Raises
        ------
        JointError
            If the tick lacks a joint; nothing has changed then.
        """


@dataclass(frozen=True)
class PairingRule:
    """A pairing rule.

    Parameters
    ----------
    name : str
        Its name, which controllers carry.
    topics : callable
        Returns the topics that a tick has a message of each, for the names of some hands: theirs, in this order, and
        the joints'.
    pairs : callable
        Makes `Pairs` of the names of the joints and the number of hands.

    Raises
    ------
    ConfigError
        If topics are not those of a tick.
    """

    name: str
    topics: Callable[[Sequence[str]], tuple[str, ...]]
    pairs: Callable[[tuple[str, ...], int], Pairs]

    def __post_init__(self) -> None:
        """Check the topics."""
        check_tick_topics(self.topics(("left", "right")))


PAIRING_RULES = Registry("pairing rule", PairingRule, room=rules, constant="RULE", group="reenact.pairs")


def find_pairing(name: str) -> PairingRule:
    """Return a pairing rule by its name; raises ConfigError if there is none."""
    return PAIRING_RULES.find(name)
