"""Episodes of a log of aligned ticks: where their numbers leave one out, one episode ends and the next begins."""

import json
from collections.abc import Sequence
from typing import Any, NamedTuple

from recorders.containers.reader import Reader
from recorders.reading.raw_messages import FOREVER_NS

ALIGNMENT = "alignment"
"""The entry of the manifest of a log of aligned ticks, and of a controller's logs: how it was aligned, as a table."""

_MOST_BYTES = 64 << 10  # of an account of an alignment, which comes with a log from anyone


class Span(NamedTuple):
    """Log times [start_ns, end_ns) of an episode [ns]."""

    start_ns: int
    end_ns: int


WHOLE = Span(0, FOREVER_NS)
"""All of a log."""


def alignment_of(reader: Reader) -> dict[str, Any] | None:
    """Return the account of how the ticks of a log were aligned, None if they were not."""
    account = reader.manifest.get(ALIGNMENT)
    return account if isinstance(account, dict) and len(json.dumps(account)) <= _MOST_BYTES else None


def episode_spans(reader: Reader, tick: Sequence[str]) -> list[Span]:
    """Return the episodes of a log: all of it is one, unless its ticks were aligned.

    Parameters
    ----------
    reader : Reader
        The log.
    tick : sequence of str
        Topics that a tick has a message of each.

    Raises
    ------
    LogError
        If the log cannot be read.
    """
    if alignment_of(reader) is None:
        return [WHOLE]
    starts, last = [0], None
    for record in reader.records(topics=tick[-1:]):
        if last is not None and record.sequence != last + 1:
            starts.append(record.log_time_ns)
        last = record.sequence
    return [Span(start, end) for start, end in zip(starts, [*starts[1:], FOREVER_NS], strict=True)]
