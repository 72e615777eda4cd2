"""Ticks as rows of bytes of one size: number, stamp, and the messages on our topics as the codec would write them."""

import struct
from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np

from pipeline.alignment.blocks import Bytes, Times
from pipeline.alignment.ticks import Source, Ticks
from pipeline.arrays import Floats
from recorders.cdr.layouts import write_message
from recorders.cdr.stream import ENCAPSULATION
from recorders.messages.message_types import JointState, PoseStamped
from recorders.messages.record import RecordedMessage

ROW_HEAD = struct.Struct("<qq")
"""What a row begins with: the stamp of the tick [ns] and its number."""

_SECOND = 10**9
_STAMP = slice(4, 12)  # of a message: seconds and nanoseconds, 4 bytes each


class RowFormat:
    """Writes ticks as rows, and reads messages from rows.

    Ticks are numbered; where one does not follow upon the one before, a number is left out.

    Parameters
    ----------
    sources : sequence of Source
        What the values of a tick are of; those without a name of ours are left out.
    joints : sequence of str
        Names of the joints, in the order of their values.

    Attributes
    ----------
    size : int
        Bytes of a row.
    topics : dict of str to str
        The topics of the messages and their types: hands in the order of the sources, then joints.
    """

    def __init__(self, sources: Sequence[Source], joints: Sequence[str]) -> None:
        posture = JointState(0, tuple(joints), np.zeros(len(joints)))
        pose = PoseStamped(0, np.zeros(3))
        named = [rank for rank, source in enumerate(sources) if source.ours]
        self._ranks = sorted(named, key=lambda rank: not sources[rank].turns)
        self._templates = [_template(pose if sources[rank].turns else posture) for rank in self._ranks]
        self.topics = {sources[rank].ours: sources[rank].kind.message.TYPE for rank in self._ranks}
        ends = np.cumsum([ROW_HEAD.size, *(len(base) for base, _ in self._templates)]).tolist()
        self._spans = [slice(start, end) for start, end in pairwise(ends)]
        self.size: int = ends[-1]
        self._next = 0

    def rows(self, ticks: Ticks) -> bytes:
        """Return ticks as rows, one after another."""
        numbers = self._next + np.arange(len(ticks.stamps_ns)) + np.cumsum(ticks.cuts)
        self._next = int(numbers[-1]) + 1
        head = np.stack((ticks.stamps_ns, numbers), axis=1).astype("<i8").view(np.uint8)
        parts = [
            _filled(base, floats, ticks.stamps_ns, ticks.values[rank])
            for rank, (base, floats) in zip(self._ranks, self._templates, strict=True)
        ]
        return np.concatenate((head, *parts), axis=1).tobytes()

    def records(self, rows: bytes) -> Iterator[RecordedMessage]:
        """Yield the messages of whole rows, tick by tick."""
        parts = [(topic, kind, where) for (topic, kind), where in zip(self.topics.items(), self._spans, strict=True)]
        for start in range(0, len(rows), self.size):
            row = rows[start : start + self.size]
            stamp, number = ROW_HEAD.unpack_from(row)
            for topic, kind, where in parts:
                yield RecordedMessage(topic, kind, row[where], number, stamp)


def _template(message: JointState | PoseStamped) -> tuple[bytes, slice]:
    """Return the bytes of a message, and where its numbers are."""
    written = write_message(message)
    runs = [run for run in written.runs if run[0] < run[1]]
    return written.payload(), slice(runs[0][0] + len(ENCAPSULATION), runs[-1][1] + len(ENCAPSULATION))


def _filled(base: bytes, floats: slice, stamps_ns: Times, values: Floats) -> Bytes:
    """Return the bytes of messages of these stamps [ns] and values, a message a row."""
    rows = np.tile(np.frombuffer(base, np.uint8), (len(stamps_ns), 1))
    rows[:, _STAMP] = np.stack((stamps_ns // _SECOND, stamps_ns % _SECOND), axis=1).astype("<u4").view(np.uint8)
    rows[:, floats] = np.ascontiguousarray(values, "<f8").view(np.uint8)
    return rows
