"""What a golden check finds: where a case and the present program first part, and what either says there."""

import dataclasses
from collections.abc import Mapping
from typing import Any

from replay.compare import Divergence

CASE, LOG, LEARNING, PHYSICS = "case", "log", "learning", "physics"
"""Tiers: the files of a case, its logs, what is learned from them (exact), what is simulated (within a tolerance)."""


@dataclasses.dataclass(frozen=True, slots=True)
class Finding:
    """The first thing that is not as a case has it.

    Parameters
    ----------
    tier : str
        `case`, `log`, `learning` or `physics`.
    field : str
        What differs: `pose.position.x`, `reservoir_output_weights[17]`, `outputs`, `message`.
    expected, found : str
        What the case holds there, and what there is now.
    place : mapping
        Where, as far as it applies: `log`, `topic`, `sequence`, `stamp_ns`, `epoch`, `cycle`, `phase`, `tick`, all of
        them counted from 0.
    note : str
        What else helps to understand it.
    """

    tier: str
    field: str
    expected: str
    found: str
    place: Mapping[str, str | int] = dataclasses.field(default_factory=dict)
    note: str = ""

    def __str__(self) -> str:
        where = ", ".join(f"{name} {value}" for name, value in self.place.items())
        line = f"{self.tier}: {where + ': ' if where else ''}{self.field}: expected {self.expected}, found {self.found}"
        return f"{line} ({self.note})" if self.note else line

    def to_dict(self) -> dict[str, Any]:
        """Return the finding for JSON: its place beside field and values, and the whole as a `text`."""
        values = {"field": self.field, "expected": self.expected, "found": self.found, "note": self.note}
        return {**self.place, **values, "text": str(self)}


def of_message(tier: str, divergence: Divergence, *, log: str = "") -> Finding:
    """Return a finding that names a message: expected is what A holds, found what B does."""
    place: dict[str, str | int] = {"log": log} if log else {}
    place |= {"topic": divergence.topic, "sequence": divergence.sequence}
    if divergence.stamp_ns is not None:
        place["stamp_ns"] = divergence.stamp_ns
    return Finding(tier, divergence.field, divergence.a, divergence.b, place, note=divergence.kind)
