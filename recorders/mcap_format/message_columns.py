"""Messages column by column: what is done with each of many is then done by loops that are written in C."""

from collections.abc import Sequence
from typing import NamedTuple, Self, TypeAlias

Pending: TypeAlias = tuple[int, int, int, int, bytes]
"""Channel, sequence, log time [ns], publish time [ns] and data of a message."""


class MessageColumns(NamedTuple):
    """One or more messages, in their order.

    Attributes
    ----------
    channels, sequences, log_times_ns, publish_times_ns : tuple of int
        Number of the channel, number of the message, time of recording and of publication [ns] of each.
    data : tuple of bytes
        The messages themselves.
    sizes : list of int
        How long each is [bytes].
    """

    channels: tuple[int, ...]
    sequences: tuple[int, ...]
    log_times_ns: tuple[int, ...]
    publish_times_ns: tuple[int, ...]
    data: tuple[bytes, ...]
    sizes: list[int]

    @classmethod
    def of(cls, messages: Sequence[Pending]) -> Self:
        """Return the columns of one or more messages."""
        channels, sequences, log_times_ns, publish_times_ns, data = zip(*messages, strict=True)
        return cls(channels, sequences, log_times_ns, publish_times_ns, data, list(map(len, data)))
