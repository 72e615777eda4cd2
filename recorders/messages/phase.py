"""Phase markers: where a session stands, as JSON in a std_msgs/msg/String."""

import json
from dataclasses import asdict, dataclass
from typing import Any

from recorders.errors import MessageError
from recorders.messages.message_types import String
from recorders.text.wording import kind_text, value_text

WASHOUT = "washout"  # the network runs, nothing is learned
LEARN = "learn"
EVALUATE = "evaluate"
PHASES = (WASHOUT, LEARN, EVALUATE)

MAX_COUNT = 1 << 31
"""Epochs and cycles stay below: a marker may come from the network."""

_KINDS = {"run": str, "epoch": int, "cycle": int, "phase": str, "log": str}


@dataclass(frozen=True, slots=True)
class Phase:
    """The purpose of the messages that follow.

    Parameters
    ----------
    run : str
        Identifier of the run.
    epoch, cycle : int
        Counted from 0.
    phase : str
        `washout`, `learn` or `evaluate`.
    log : str
        Digest of the ticks of the log that is replayed; empty for a live session.

    Raises
    ------
    MessageError
        If a value has the wrong type or the phase is unknown.
    """

    run: str
    epoch: int
    cycle: int
    phase: str
    log: str

    def __post_init__(self) -> None:
        """Check types and ranges."""
        for name, kind in _KINDS.items():
            value = getattr(self, name)
            if type(value) is not kind:  # exactly: JSON's true would pass as an int
                raise MessageError(f"phase marker: {name} must be {kind_text(kind)}, found {value_text(value)}")
        if not (0 <= self.epoch < MAX_COUNT and 0 <= self.cycle < MAX_COUNT):
            raise MessageError(
                f"phase marker: epoch and cycle count from 0 to {MAX_COUNT - 1}, found a number out of range"
            )
        if self.phase not in PHASES:
            raise MessageError(f"phase marker: unknown phase {self.phase!r}; there are {', '.join(PHASES)}")

    def to_message(self) -> String:
        """Return the marker as compact JSON, keys in the order of the fields."""
        return String(json.dumps(asdict(self), separators=(",", ":")))

    @classmethod
    def from_message(cls, message: String) -> "Phase":
        """Parse a marker.

        Raises
        ------
        MessageError
            If the text is not JSON, keys are missing or unknown, or a value has the wrong type.
        """
        values = _parse(message.data)
        if not isinstance(values, dict) or values.keys() != _KINDS.keys():
            raise MessageError(f"phase marker: expected keys {', '.join(_KINDS)}, found {message.data[:200]!r}")
        return cls(**values)


def _parse(text: str) -> Any:
    try:
        return json.loads(text)
    except (ValueError, RecursionError):
        raise MessageError(f"phase marker: expected JSON, found {text[:200]!r}") from None
