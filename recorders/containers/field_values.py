"""Fields of messages of any type, for readers: by the definitions of their channel, as plain values."""

import base64
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from recorders.containers.decoding import field_reader
from recorders.errors import ReenactError
from recorders.mcap_format.channels import DeclaredChannel
from recorders.messages.record import RecordedMessage

_MOST_READERS = 4096  # whoever publishes may take any number of topics


class FieldValues:
    """Reads the fields of messages.

    Parameters
    ----------
    channels : sequence of DeclaredChannel
        The channels of their recording, of several of one topic the first; messages on no channel are CDR of a standard
        type of ROS 2.
    """

    def __init__(self, channels: Sequence[DeclaredChannel] = ()) -> None:
        self._channels = {channel.topic: channel for channel in reversed(channels)}
        self._readers: dict[tuple[str, str], Callable[[bytes], Mapping[str, Any]] | ReenactError] = {}

    def read(self, record: RecordedMessage, *, as_json: bool = True) -> dict[str, Any]:
        """Return the fields of a message: numbers, texts, lists, and fields of fields; bytes are base64 texts.

        Parameters
        ----------
        record : RecordedMessage
            The message.
        as_json : bool
            Whether numbers that JSON lacks come as the texts `NaN`, `Infinity` and `-Infinity`.

        Raises
        ------
        MessageError
            If the encoding or definition cannot be read, or the message is none.
        MissingExtra
            If the encoding needs a package that is not installed.
        """
        key = record.topic, record.type
        if key not in self._readers:
            if len(self._readers) >= _MOST_READERS:
                self._readers.clear()
            self._readers[key] = self._find(record)
        found = self._readers[key]
        if isinstance(found, ReenactError):
            raise found
        fields: dict[str, Any] = plain(found(record.data), as_json=as_json)
        return fields

    def _find(self, record: RecordedMessage) -> Callable[[bytes], Mapping[str, Any]] | ReenactError:
        of_no_channel = DeclaredChannel(record.topic, "cdr", schema=(record.type, "ros2msg", b""))
        try:
            return field_reader(self._channels.get(record.topic, of_no_channel))
        except ReenactError as error:
            return error


def plain(value: Any, *, as_json: bool = True) -> Any:
    """Return a value as JSON has it; numbers that it lacks as the texts `NaN` and so on, unless `as_json` is false."""
    number = _number if as_json else _same
    match value:
        case Mapping():
            return {str(name): plain(item, as_json=as_json) for name, item in value.items()}
        case np.ndarray() if value.dtype.itemsize == 1 and value.dtype != np.bool_:
            return base64.b64encode(value.tobytes()).decode()
        case np.ndarray():
            return [number(item) for item in value.tolist()]
        case bytes():
            return base64.b64encode(value).decode()
        case float():
            return number(value)
        case str() | bool() | int() | None:
            return value
        case Sequence():
            return [plain(item, as_json=as_json) for item in value]
        case _:
            return str(value)


def _same(value: Any) -> Any:
    return value


def _number(value: Any) -> Any:
    if not isinstance(value, float) or math.isfinite(value):
        return value
    return "NaN" if math.isnan(value) else "Infinity" if value > 0 else "-Infinity"
