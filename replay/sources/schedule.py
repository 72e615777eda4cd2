"""The training schedule: how often each log is presented, what for, and which of its topics make a tick."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Self

from recorders.errors import ConfigError
from recorders.messages.phase import EVALUATE, LEARN, PHASES, WASHOUT
from recorders.messages.topics import COMMANDED_TICK
from recorders.text.wording import value_text
from recorders.ticks.joiner import check_tick_topics

MAX_CYCLES = 1_000_000
"""More cycles an epoch than anyone presents: a schedule may come from the network."""


@dataclass(frozen=True)
class Schedule:
    """Epochs of cycles; a cycle is one presentation of every log.

    Parameters
    ----------
    epochs : int
        How many epochs; 150 for pattern 1, 600 for pattern 2 (paper, section III-B).
    phases : tuple of (str, int)
        Phases of an epoch with their numbers of cycles, in order: one cycle without learning, five with, one
        evaluated (paper, section III-B).
    topics : tuple of str
        Topics that are presented: those of a tick.

    Raises
    ------
    ConfigError
        If a number is out of range, a phase is unknown, or topics are not those of a tick.

    Examples
    --------
    >>> list(Schedule(epochs=1, phases=(("learn", 2), ("evaluate", 1))).cycles_of_epoch())
    [(0, 'learn'), (1, 'learn'), (2, 'evaluate')]
    """

    epochs: int = 150
    phases: tuple[tuple[str, int], ...] = ((WASHOUT, 1), (LEARN, 5), (EVALUATE, 1))
    topics: tuple[str, ...] = COMMANDED_TICK

    def __post_init__(self) -> None:
        """Check ranges and names."""
        if type(self.epochs) is not int or not 1 <= self.epochs <= MAX_CYCLES:
            raise ConfigError(
                f"epochs: expected a whole number from 1 to {MAX_CYCLES}, found {value_text(self.epochs)}"
            )
        for phase, cycles in self.phases:
            if phase not in PHASES:
                raise ConfigError(f"phase: expected one of {', '.join(PHASES)}, found {value_text(phase)}")
            if type(cycles) is not int or not 1 <= cycles <= MAX_CYCLES:
                raise ConfigError(
                    f"{phase}: expected a whole number of cycles from 1 to {MAX_CYCLES}, found {value_text(cycles)}"
                )
        if not self.phases:
            raise ConfigError("phases: expected at least one, found none")
        check_tick_topics(self.topics)

    @property
    def cycles(self) -> int:
        """Cycles of one epoch."""
        return sum(cycles for _, cycles in self.phases)

    def cycles_of_epoch(self) -> Iterator[tuple[int, str]]:
        """Yield (cycle, phase) for the cycles of one epoch."""
        cycle = 0
        for phase, cycles in self.phases:
            for _ in range(cycles):
                yield cycle, phase
                cycle += 1

    def to_dict(self) -> dict[str, Any]:
        """Return the schedule for JSON; topics as commanded are not named."""
        named = {} if self.topics == COMMANDED_TICK else {"topics": list(self.topics)}
        return {"epochs": self.epochs, "phases": [list(phase) for phase in self.phases]} | named

    @classmethod
    def from_dict(cls, fields: Mapping[str, Any]) -> Self:
        """Read a schedule back; raises ConfigError if it is not one."""
        try:
            phases = tuple((phase, cycles) for phase, cycles in fields["phases"])
            topics = tuple(fields.get("topics", COMMANDED_TICK))
            return cls(fields["epochs"], phases, topics)
        except (AttributeError, KeyError, TypeError, ValueError) as error:
            raise ConfigError(f"schedule: expected epochs and phases, found {str(fields)[:80]}") from error
