"""A stream of messages between one sender and its consumers: offer, consumer, progress. No transport."""

import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from typing import Any, Protocol, Self

from recorders.errors import WireError
from recorders.records import Stamped

PROTOCOL_VERSION = 1

_OFFER_TYPES: dict[str, type | tuple[type, ...]] = {
    "run": str,
    "sender": str,
    "schedule": dict,
    "logs": list,
    "robot": dict,
    "window": int,
    "version": int,
}
_PROGRESS_TYPES: dict[str, type | tuple[type, ...]] = {
    "run": str,
    "next": int,
    "received": int,
    "result": (dict, type(None)),
    "error": (str, type(None)),
}


@dataclass(frozen=True)
class Offer:
    """What a sender says of its stream before the first message.

    Parameters
    ----------
    run : str
        32 hexadecimal digits that name the stream: the same logs and schedule give the same run.
    schedule : dict
        `epochs` and `phases`, as `replay.schedule.Schedule.to_dict` gives them.
    logs : list of dict
        `name` and `content_sha256` of each log.
    robot : dict
        `toml` and `urdf`: the robot that was recorded. Empty if the logs carry none.
    sender : str
        Names this sender among others that may offer the same run; filled in by the transport.
    window : int
        How many messages the transport lets be under way; consumers acknowledge at least every half of it.
    """

    run: str
    schedule: dict[str, Any]
    logs: list[dict[str, Any]]
    robot: dict[str, str] = field(default_factory=dict)
    sender: str = ""
    window: int = 1
    version: int = PROTOCOL_VERSION

    @property
    def run_bytes(self) -> bytes:
        """The run as the 16 bytes that every attachment carries."""
        return bytes.fromhex(self.run)

    def to_json(self) -> bytes:
        """Return the offer as JSON."""
        return json.dumps(asdict(self)).encode()

    @classmethod
    def from_json(cls, data: bytes) -> Self:
        """Read an offer back; raises WireError if it is not one."""
        fields = _json_object(data, _OFFER_TYPES)
        offer = cls(**fields)
        if offer.version != PROTOCOL_VERSION:
            raise WireError(f"offer: expected protocol version {PROTOCOL_VERSION}, found {offer.version}")
        try:
            well_formed = len(offer.run_bytes) == 16
        except ValueError:
            well_formed = False
        if not well_formed or offer.window < 1:
            raise WireError(
                f"offer: expected a run of 32 hexadecimal digits and a window, found {offer.run[:40]!r}, {offer.window}"
            )
        return offer


class Consumer(Protocol):
    """What takes a stream: a learner, a recorder. The same object serves every transport."""

    def hello(self, offer: Offer) -> int:
        """Return the stream index wanted next; raise ReenactError to refuse the offer."""

    def consume(self, messages: Iterator[Stamped]) -> dict[str, Any]:
        """Take the whole stream, from the index named in `hello` on, and return what is to be said of it (JSON)."""


@dataclass(frozen=True)
class Progress:
    """How far a consumer has come: its acknowledgement, and its answer to hello and status.

    Parameters
    ----------
    run : str
        The run it consumes, or an empty string.
    next : int
        Stream index up to which everything is consumed.
    received : int
        Stream index up to which everything has arrived.
    result : dict, optional
        What the consumer made of the whole stream, once it is through.
    error : str, optional
        Why the consumer refuses, or stopped.
    """

    run: str = ""
    next: int = 0
    received: int = 0
    result: dict[str, Any] | None = None
    error: str | None = None

    def to_json(self) -> bytes:
        """Return the progress as JSON."""
        return json.dumps(asdict(self)).encode()

    @classmethod
    def from_json(cls, data: bytes) -> Self:
        """Read a progress back; raises WireError if it is not one."""
        return cls(**_json_object(data, _PROGRESS_TYPES))


def _json_object(data: bytes, types: dict[str, type | tuple[type, ...]]) -> dict[str, Any]:
    try:
        found = json.loads(data)
    except (ValueError, RecursionError) as error:
        raise WireError(f"expected JSON, found {data[:40]!r}") from error
    if not isinstance(found, dict) or set(found) != set(types):
        raise WireError(f"expected an object with {', '.join(types)}, found {data[:80]!r}")
    for name, kind in types.items():
        if not isinstance(found[name], kind) or isinstance(found[name], bool):
            raise WireError(f"{name}: found {found[name]!r:.40}, which is of the wrong type")
    return found
