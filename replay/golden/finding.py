"""Findings of a golden check: where a case and the present program first part, and both values there."""

import dataclasses
import traceback
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from recorders.errors import ReenactError
from recorders.mcap_format.manifest import environment
from recorders.text.wording import escape_control, line_text
from replay.diff.divergence import Divergence

CASE, LOG, LEARNING, PHYSICS = "case", "log", "learning", "physics"
"""Tiers: the files of a case, its logs, what is learned from them (exact), what is simulated (within a tolerance)."""


@dataclasses.dataclass(frozen=True, slots=True)
class ElementDifference:
    """The first element of the state that differs at the end of an epoch: its name, as in `x[17]`, and both values."""

    epoch: int
    field: str
    expected: str
    found: str


@dataclasses.dataclass(frozen=True, slots=True)
class Finding:
    """The first thing that is not as a case has it.

    Parameters
    ----------
    tier : str
        `case`, `log`, `learning` or `physics`.
    field : str
        What differs: `pose.position.x`, `message`, or what parted at a tick: `stream`, `outputs` or `state`.
    expected, found : str
        What the case holds there, and what there is now.
    place : mapping
        Where, as far as it applies: `log`, `topic`, `sequence`, `stamp_ns`, `epoch`, `cycle`, `phase`, `tick`, all of
        them counted from 0.
    note : str
        What else helps to understand it.
    epoch_end : ElementDifference, optional
        Of a run that parted at a tick, the element that differs once that tick's epoch is over: a case keeps digests
        of every tick, but states of the ends of epochs alone.
    environment : tuple of str
        In what the environment is not the one that the case was made in: `numpy 2.4.6, now 2.5.0`.
    """

    tier: str
    field: str
    expected: str
    found: str
    place: Mapping[str, str | int] = dataclasses.field(default_factory=dict)
    note: str = ""
    epoch_end: ElementDifference | None = None
    environment: tuple[str, ...] = ()

    def __str__(self) -> str:
        where = ", ".join(f"{name} {value}" for name, value in self.place.items())
        line = f"{self.tier}: {where + ': ' if where else ''}{self.field}: expected {self.expected}, found {self.found}"
        return escape_control(line + (f" ({'; '.join(self._remarks())})" if any(self._remarks()) else ""))

    def to_dict(self) -> dict[str, Any]:
        """Return the finding for JSON: its place beside field and values, and the whole as a `text`."""
        values = {name: getattr(self, name) for name in ("field", "expected", "found", "note")}
        end = None if self.epoch_end is None else dataclasses.asdict(self.epoch_end)
        return {**self.place, **values, "epoch_end": end, "environment": list(self.environment), "text": str(self)}

    def _remarks(self) -> Iterator[str]:
        if self.note:
            yield self.note
        if end := self.epoch_end:
            yield f"at the end of epoch {end.epoch} {end.field}: expected {end.expected}, found {end.found}"
        if self.environment:
            yield f"the case was made with {', '.join(self.environment)}"


def of_message(tier: str, divergence: Divergence, *, log: str = "") -> Finding:
    """Return a finding that names a message: expected is what A holds, found what B does."""
    place: dict[str, str | int] = {"log": log} if log else {}
    place |= {"topic": divergence.topic, "sequence": divergence.sequence}
    if divergence.stamp_ns is not None:
        place["stamp_ns"] = divergence.stamp_ns
    return Finding(tier, divergence.field, divergence.a, divergence.b, place, note=divergence.kind)


def error_text(error: Exception) -> str:
    """Return an error as one line: ours as it is, any other with its type and the place where it was raised."""
    if isinstance(error, ReenactError):
        return str(error)
    text = line_text(str(error), limit=200)
    frames = traceback.extract_tb(error.__traceback__)
    place = f" at {Path(frames[-1].filename).name}:{frames[-1].lineno}" if frames else ""
    return f"{type(error).__name__}{place}: {text}"


def changed_environment(expected: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the differences of the present environment from that of a case."""
    old, new = dict(_flat(expected)), dict(_flat(environment()))
    names = [name for name in {**old, **new} if old.get(name) != new.get(name)]
    return tuple(f"{name} {old.get(name, 'absent')}, now {new.get(name, 'absent')}" for name in names)


def _flat(values: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    for name, value in values.items():
        if isinstance(value, Mapping):
            yield from _flat(value)
        else:
            yield name, str(value)[:80]
