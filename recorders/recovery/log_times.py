"""Times of the messages of a recording, by topic: when each was recorded, and which stamp it carries."""

from array import array
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from recorders.containers.decoding import stamp_reader
from recorders.containers.opening import open_as_it_is
from recorders.errors import MessageError
from recorders.reading.parts import Log

NO_STAMP = -(2**62)
"""What stands for the stamp of a message that has none."""


@dataclass(frozen=True, eq=False)
class TopicTimes:
    """Times of the messages of one topic, in order of the file.

    Attributes
    ----------
    log_times_ns : ndarray, shape (n,)
        When each was recorded [ns].
    stamps_ns : ndarray, shape (n,)
        The stamp of each [ns], `NO_STAMP` where it has none.
    """

    log_times_ns: NDArray[np.int64]
    stamps_ns: NDArray[np.int64]


@dataclass
class _Times:
    log_times: "array[int]" = field(default_factory=lambda: array("q"))
    stamps: "array[int]" = field(default_factory=lambda: array("q"))


def read_times(log: Log) -> dict[str, TopicTimes]:
    """Return the times of the messages of each topic that has any; 16 bytes of memory for a message.

    Raises
    ------
    LogError
        If the recording cannot be read.
    """
    reader = open_as_it_is(log)
    stamp_of = {channel.topic: stamp_reader(channel) for channel in reversed(reader.channels)}
    found: dict[str, _Times] = {}
    for record in reader.records(file_order=True):
        times = found.setdefault(record.topic, _Times())
        try:
            stamp = stamp_of[record.topic](record.data)
        except MessageError:
            stamp = None
        times.log_times.append(min(record.log_time_ns, -NO_STAMP))
        times.stamps.append(NO_STAMP if stamp is None else stamp)
    return {
        topic: TopicTimes(np.array(times.log_times, np.int64), np.array(times.stamps, np.int64))
        for topic, times in found.items()
    }
