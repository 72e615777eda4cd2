"""The seam for pairing rules: which topics make a tick, and how ticks become the steps that a learner takes.

A rule is a module with `RULE`, a `PairingRule`: here in `pipeline.samples.rules`, named as the rule is, or in a
distribution of others, under an entry point of the group `reenact.pairs`. `pipeline.samples.contract` has tests for it.
"""

import logging
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from typing import Protocol

from pipeline.arrays import Floats
from pipeline.robot.config import RobotConfig
from pipeline.samples import rules
from recorders.registry import Registry
from recorders.text.wording import names_text
from recorders.ticks.joiner import Tick, check_tick_topics

logger = logging.getLogger(__name__)

COMMANDED = "commanded"
"""The paper's rule, of controllers that name none."""


class Pairs(Protocol):
    """Turns the ticks of a cycle into steps: an input u and what it is taught, d = (hand positions; joints).

    Made as `PairingRule.pairs(robot)`: of joints and hands in the order of the robot's.
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
        the joints', or the joints' alone.
    pairs : callable
        Makes `Pairs` of a robot.
    otherwise : str
        Name of the rule that takes its place where a log or a stream lacks topics of it; none if empty. Its topics are
        among those of the rule.

    Raises
    ------
    ConfigError
        If topics are not those of a tick.
    """

    name: str
    topics: Callable[[Sequence[str]], tuple[str, ...]]
    pairs: Callable[[RobotConfig], Pairs]
    otherwise: str = ""

    def __post_init__(self) -> None:
        """Check the topics."""
        check_tick_topics(self.topics(("left", "right")))

    def missing(self, hands: Sequence[str], topics: Collection[str]) -> list[str]:
        """Return the topics of a tick, of hands of these names, that are not among others."""
        return [topic for topic in self.topics(hands) if topic not in topics]


PAIRING_RULES = Registry("pairing rule", PairingRule, room=rules, constant="RULE", group="reenact.pairs")


def find_pairing(name: str) -> PairingRule:
    """Return a pairing rule by its name; raises ConfigError if there is none."""
    return PAIRING_RULES.find(name)


def fitting_pairing(pairing: PairingRule, hands: Sequence[str], topics: Collection[str], *, where: str) -> PairingRule:
    """Return a pairing rule, or the one in its place where topics are not all there; that is logged.

    Parameters
    ----------
    pairing : PairingRule
        The rule that is asked for.
    hands : sequence of str
        Names of the robot's hands.
    topics : collection of str
        Topics that are there.
    where : str
        Names the log or the stream that has them.
    """
    missing = pairing.missing(hands, topics)
    if not missing or not pairing.otherwise:
        return pairing
    other = find_pairing(pairing.otherwise)
    logger.info(f"pairs {other.name}, in place of {pairing.name}: {where} has no {names_text(missing)}")
    return other
