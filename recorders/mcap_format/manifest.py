"""The manifest of a log: the program that wrote it, its environment, and the hash of its messages."""

import hashlib
import json
import platform
import struct
from collections.abc import Iterable, Mapping
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from recorders.errors import DISTRIBUTION, LogError
from recorders.mcap_format.chunk_contents import MessageColumns
from recorders.mcap_format.migrations import upgrade
from recorders.mcap_format.unread import Unread
from recorders.messages.record import RecordedMessage
from recorders.text.wording import value_text

FORMAT_VERSION = 2
METADATA_NAME = "reenact"  # the name of the MCAP metadata record

_ENVIRONMENT = "environment"  # what `LogWriter` always adds
_MOST_NAMES = 2**21  # characters of all topics: the summary counts them too
_CHECKSUM = "manifest_sha256"
_PACKAGES = ("drake", "eclipse-zenoh", "llvmlite", "lz4", "mcap", "numba", "numpy", "pin", "rosbags")
_DISTRIBUTIONS = {"reenact": DISTRIBUTION, **dict(zip(_PACKAGES, _PACKAGES, strict=True))}

FRAME = struct.Struct("<IQQ")
"""What is hashed of a message beside its topic and data: sequence, log time [ns], length of the data."""


class ContentHash:
    """SHA-256 over the messages of a log, in file order: topic, sequence, log time and bytes of each.

    Every field of varying length is preceded by its length, so no two different logs are hashed alike.
    """

    def __init__(self) -> None:
        self._hash = hashlib.sha256()
        self._topics: dict[str, bytes] = {}

    def add(self, topic: str, sequence: int, log_time_ns: int, data: bytes, rest: Unread | None = None) -> None:
        """Take in one message; of a large one the `rest` may be in its file."""
        size = len(data) + (rest.size if rest else 0)
        self._hash.update(self._framed(topic) + FRAME.pack(sequence, log_time_ns, size))
        self._hash.update(data)
        for piece in rest.pieces() if rest else ():
            self._hash.update(piece)

    def add_all(self, frames: Mapping[int, bytes], messages: MessageColumns) -> None:
        """Take in messages, given the `topic_frame` of each of their channels."""
        parts = [b""] * (3 * len(messages.data))
        parts[::3] = map(frames.__getitem__, messages.channels)
        parts[1::3] = map(FRAME.pack, messages.sequences, messages.log_times_ns, messages.sizes)
        parts[2::3] = messages.data
        self._hash.update(b"".join(parts))

    def _framed(self, topic: str) -> bytes:
        """Return a topic behind its length."""
        framed = self._topics.get(topic)
        if framed is None:
            framed = self._topics[topic] = topic_frame(topic)
        return framed

    def hexdigest(self) -> str:
        """Return the hash of everything taken in so far."""
        return self._hash.hexdigest()


def topic_frame(topic: str) -> bytes:
    """Return the name of a topic as it is hashed with each message."""
    name = topic.encode()
    return len(name).to_bytes(4, "little") + name


def content_sha256(records: Iterable[RecordedMessage]) -> str:
    """Return the `content_sha256` that a log of these records has in its manifest."""
    content = ContentHash()
    for record in records:
        content.add(record.topic, record.sequence, record.log_time_ns, record.data)
    return content.hexdigest()


def environment() -> dict[str, Any]:
    """Return the environment fingerprint: interpreter, machine and package versions; no time, user, host or path."""
    return {
        "python": platform.python_version(),
        "implementation": platform.python_implementation(),
        "system": platform.system(),
        "machine": platform.machine(),
        "cpu": _cpu_model(),
        "packages": {name: found for name, installed in _DISTRIBUTIONS.items() if (found := _version(installed))},
    }


def stated_counts(counts: Mapping[str, int]) -> dict[str, int] | None:
    """Return numbers of messages by topic as a manifest states them; None if the topics' names are too long for it."""
    return dict(counts) if sum(map(len, counts)) <= _MOST_NAMES else None


def to_metadata(manifest: Mapping[str, Any]) -> dict[str, str]:
    """Return the manifest as MCAP metadata: each value as JSON, and a checksum over them all.

    Raises
    ------
    LogError
        If a key is not a string or a value is not JSON (NaN is not).
    """
    texts = {key: _to_json(key, manifest[key]) for key in manifest}
    texts = dict(sorted(texts.items()))
    return {**texts, _CHECKSUM: _checksum(texts)}


def from_metadata(metadata: Mapping[str, str]) -> dict[str, Any]:
    """Return the manifest that `to_metadata` wrote, that of an older format brought up to the present one.

    Raises
    ------
    LogError
        If the checksum does not hold, or the log is of a format that this program does not know.
    """
    texts = {key: text for key, text in metadata.items() if key != _CHECKSUM}
    if metadata.get(_CHECKSUM) != _checksum(texts):
        raise LogError("the manifest is damaged: its checksum does not hold")
    try:
        manifest = {key: json.loads(text) for key, text in texts.items()}
    except (ValueError, RecursionError):
        raise LogError("the manifest is not JSON") from None
    found = manifest.get("format_version")
    if type(found) is not int or not 1 <= found <= FORMAT_VERSION:  # True is an int, and equal to 1
        raise LogError(
            f"expected log format {FORMAT_VERSION} or older, found {value_text(found)}: it needs a newer reenact"
        )
    return upgrade(manifest)


def is_of_our_writer(manifest: Mapping[str, Any]) -> bool:
    """Whether a manifest is that of a log of ours, not of another program's that was recovered."""
    return _ENVIRONMENT in manifest


def _to_json(key: Any, value: Any) -> str:
    if not isinstance(key, str):
        raise LogError(f"manifest: expected keys that are strings, found {value_text(key)}")
    try:
        return json.dumps(value, allow_nan=False, sort_keys=True)
    except (TypeError, ValueError, RecursionError) as error:
        raise LogError(f"manifest: {key} cannot be written as JSON: {error}") from None


def _checksum(texts: Mapping[str, str]) -> str:
    return hashlib.sha256(json.dumps(sorted(texts.items())).encode()).hexdigest()


@cache  # so that the next part of a recording needs no other file
def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


@cache
def _cpu_model() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        lines = []
    models = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(models, platform.processor())
