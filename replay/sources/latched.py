"""Latched messages of a recording: which of them were published before what is played, and are to come first."""

from collections import Counter, deque
from collections.abc import Iterator, Mapping
from itertools import chain

from recorders.messages.record import RecordedMessage, publish_time_ns


class EarlyMessages:
    """The messages of latched topics that subscribers had before a time: of each topic the last ones, as it keeps them.

    One that was recorded later is early if it was published before, as a recorder gets it that itself came later.

    Parameters
    ----------
    depths : mapping of str to int
        How many messages are kept for late joiners, by topic; topics that are not latched are not in it.
    begin_ns : int
        The time [ns].
    """

    def __init__(self, depths: Mapping[str, int], begin_ns: int) -> None:
        self._depths = depths
        self._begin_ns = begin_ns

    def first(
        self,
        before: Iterator[RecordedMessage],
        latched: Iterator[RecordedMessage],
        everything: Iterator[RecordedMessage],
    ) -> Iterator[RecordedMessage]:
        """Yield early messages, as of the beginning, and then the others.

        Parameters
        ----------
        before, latched : iterator of RecordedMessage
            Those of latched topics that were recorded before the time, and from then on.
        everything : iterator of RecordedMessage
            Those of all topics from then on.
        """
        kept = {topic: deque[RecordedMessage](maxlen=depth) for topic, depth in self._depths.items()}
        for record in before:
            kept[record.topic].append(record)
        earlier = [record for messages in kept.values() for record in messages]
        earlier.sort(key=lambda record: record.log_time_ns)
        for record in chain(earlier, (record for early, record in self._marked(latched) if early)):
            yield RecordedMessage(*record)._replace(log_time_ns=self._begin_ns)
        yield from (record for early, record in self._marked(everything) if not early)

    def _marked(self, records: Iterator[RecordedMessage]) -> Iterator[tuple[bool, RecordedMessage]]:
        """Yield the messages and whether each is early; no more of a topic than it keeps."""
        counts: Counter[str] = Counter()
        for record in records:
            depth = self._depths.get(record.topic, 0)
            early = counts[record.topic] < depth and publish_time_ns(record) <= self._begin_ns
            counts[record.topic] += early
            yield early, record
