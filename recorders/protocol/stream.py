"""A stream of messages between one sender and its consumers: offer, consumer, progress. No transport."""

import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, Protocol, Self

from recorders.errors import WireError
from recorders.messages.record import RecordedMessage
from recorders.text.wording import value_text

PROTOCOL_VERSION = 2

MAX_MESSAGE = 64 << 20
"""The largest message that travels [bytes]: an uncompressed picture takes 33 MB in 4K."""

WINDOW_BYTES = 64 << 20
"""How much may be under way unacknowledged [bytes], whatever the window allows; beside less than a quarter of it, one
more frame may, however large."""

_MAX_INDEX = 2**63 - 1
_FAREWELL = b"farewell "

_OFFER_TYPES: dict[str, type | tuple[type, ...]] = {
    "run": str,
    "sender": str,
    "schedule": dict,
    "logs": list,
    "robot": dict,
    "messages": (int, type(None)),
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
    """The description of a stream that a sender gives before the first message.

    Parameters
    ----------
    run : str
        32 hexadecimal digits that name the stream: the same logs and schedule give the same run.
    schedule : dict
        `epochs` and `phases`, as `replay.sources.schedule.Schedule.to_dict` gives them.
    logs : list of dict
        `name` and `ticks_sha256` of each log.
    robot : dict
        `toml` and `urdf`: the robot that was recorded. Empty if the logs carry none.
    messages : int, optional
        How many messages the stream has; unknown of a live one.
    sender : str
        32 hexadecimal digits of this sender among others that offer the same run; the transport fills them in.
    window : int
        How many messages the transport lets be under way, beside less than half of it one more batch; consumers
        acknowledge at least every half of it.
    """

    run: str
    schedule: dict[str, Any]
    logs: list[dict[str, Any]]
    robot: dict[str, str] = field(default_factory=dict)
    messages: int | None = None
    sender: str = "0" * 32
    window: int = 1
    version: int = PROTOCOL_VERSION

    @property
    def identity(self) -> tuple[bytes, bytes]:
        """Run and sender, as the 16 bytes each that every attachment carries."""
        return bytes.fromhex(self.run), bytes.fromhex(self.sender)

    def to_json(self) -> bytes:
        """Return the offer as JSON."""
        return json.dumps(vars(self)).encode()

    @classmethod
    def from_json(cls, data: bytes) -> Self:
        """Read an offer back; raises WireError if it is not one."""
        fields = _json_object(data, _OFFER_TYPES)
        offer = cls(**fields)
        if offer.version != PROTOCOL_VERSION:
            raise WireError(f"offer: expected protocol version {PROTOCOL_VERSION}, found {offer.version}")
        if not (is_identifier(offer.run) and is_identifier(offer.sender) and 1 <= offer.window <= _MAX_INDEX):
            raise WireError(
                "offer: expected 32 hexadecimal digits as run and as sender, and a window, "
                f"found {offer.run[:40]!r}, {offer.sender[:40]!r}, {offer.window}"
            )
        return offer


class Consumer(Protocol):
    """A consumer of a stream: a learner, a recorder. The same object serves every transport."""

    def hello(self, offer: Offer) -> int:
        """Return the stream index wanted next; raise ReenactError to refuse the offer."""

    def consume(self, messages: Iterator[RecordedMessage]) -> dict[str, Any]:
        """Take the whole stream, from the index named in `hello` on, and return the result to report (JSON)."""


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
    digest : str, optional
        Digest of the messages that arrived, in hexadecimal, beside the result.
    """

    run: str = ""
    next: int = 0
    received: int = 0
    result: dict[str, Any] | None = None
    error: str | None = None
    digest: str | None = None

    @property
    def is_final(self) -> bool:
        """Whether the consumer is through with the stream: it has a result, or stopped."""
        return self.result is not None or self.error is not None

    def to_json(self) -> bytes:
        """Return the progress as JSON; without a digest as version 1 has it, which is to read why it is refused."""
        fields = vars(self)
        if self.digest is None:
            fields = {name: value for name, value in fields.items() if name != "digest"}
        return json.dumps(fields).encode()

    @classmethod
    def from_json(cls, data: bytes) -> Self:
        """Read a progress back; raises WireError if it is not one."""
        progress = cls(**_json_object(data, _PROGRESS_TYPES, {"digest": str}))
        if not 0 <= progress.next <= progress.received <= _MAX_INDEX:
            raise WireError(f"progress: expected 0 <= next <= received, found {progress.next} and {progress.received}")
        return progress


def asking(offer: Offer, *, farewell: bool = False) -> bytes:
    """Return what a sender asks a consumer's `status` with: who it is, and whether it has all that it needs."""
    return (_FAREWELL if farewell else b"") + offer.sender.encode()


def asker(asked: bytes) -> str:
    """Return the sender that asks, from the bytes that `asking` returns."""
    return asked.removeprefix(_FAREWELL).decode(errors="replace")


def is_acknowledged(count: int, size: int, window: int) -> bool:
    """Whether a consumer acknowledges so many messages, of so many bytes: half a window, or a quarter of the bytes.

    Both ends go by it: a sender waits for what consumers acknowledge, and for nothing less.

    Parameters
    ----------
    count, size : int
        How many messages were consumed since the last acknowledgement, and their size [bytes].
    window : int
        How many messages may be under way, as the offer gives it.
    """
    return count >= max(1, window // 2) or size >= WINDOW_BYTES // 4


def is_identifier(text: str) -> bool:
    """Whether a text is 32 hexadecimal digits, as they name a run or a sender."""
    return re.fullmatch("[0-9a-f]{32}", text) is not None


def _json_object(
    data: bytes,
    types: dict[str, type | tuple[type, ...]],
    optional: Mapping[str, type] = MappingProxyType({}),
) -> dict[str, Any]:
    try:
        found = json.loads(data)
    except (ValueError, RecursionError) as error:
        raise WireError(f"expected JSON, found {value_text(data[:40])}") from error
    if not isinstance(found, dict) or found.keys() - optional.keys() != types.keys():
        raise WireError(f"expected an object with {', '.join(types)}, found {value_text(data[:80])}")
    for name, kind in (*types.items(), *((name, kind) for name, kind in optional.items() if name in found)):
        if not isinstance(found[name], kind) or isinstance(found[name], bool):
            raise WireError(f"{name}: found {value_text(found[name])}, which is of the wrong type")
    return found
