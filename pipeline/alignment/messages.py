"""Ticks as messages on our topics, many at a time: the bytes that the codec would write."""

from collections.abc import Iterator, Sequence

import numpy as np

from pipeline.alignment.blocks import Times
from pipeline.alignment.ticks import Source, Ticks
from pipeline.arrays import Floats
from recorders.cdr.layouts import write_message
from recorders.cdr.stream import ENCAPSULATION
from recorders.messages.message_types import JointState, PoseStamped
from recorders.messages.record import RecordedMessage

_SECOND = 10**9
_STAMP = slice(4, 12)


class TickMessages:
    """Writes ticks, and numbers them: where one does not follow upon the one before, a number is left out.

    Parameters
    ----------
    sources : sequence of Source
        What the values of a tick are of.
    joints : sequence of str
        Names of the joints, in the order of their values.
    """

    def __init__(self, sources: Sequence[Source], joints: Sequence[str]) -> None:
        posture = JointState(0, tuple(joints), np.zeros(len(joints)))
        pose = PoseStamped(0, np.zeros(3))
        self._parts = [
            (rank, source.ours, source.kind.message.TYPE, *_template(pose if source.turns else posture))
            for rank, source in enumerate(sources)
        ]
        self._parts.sort(key=lambda part: (part[2] == JointState.TYPE, part[0]))  # hands, then joints
        self._next = 0

    def records(self, ticks: Ticks) -> Iterator[RecordedMessage]:
        """Yield the messages of ticks, tick by tick: hands in the order of the sources, then joints."""
        payloads = [_filled(base, floats, ticks.stamps_ns, ticks.values[rank]) for rank, *_, base, floats in self._parts]
        for place, (stamp, cut) in enumerate(zip(ticks.stamps_ns.tolist(), ticks.cuts.tolist(), strict=True)):
            self._next += cut
            for (_, topic, kind, _, _), (data, size) in zip(self._parts, payloads, strict=True):
                payload = data[place * size : (place + 1) * size]
                yield RecordedMessage(topic, kind, payload, self._next, stamp)
            self._next += 1


def _template(message: JointState | PoseStamped) -> tuple[bytes, slice]:
    """Return the bytes of a message, and where its numbers are."""
    written = write_message(message)
    runs = [run for run in written.runs if run[0] < run[1]]
    return written.payload(), slice(runs[0][0] + len(ENCAPSULATION), runs[-1][1] + len(ENCAPSULATION))


def _filled(base: bytes, floats: slice, stamps_ns: Times, values: Floats) -> tuple[bytes, int]:
    """Return the payloads of messages of these stamps [ns] and values, one after the other, and the size of each."""
    rows = np.tile(np.frombuffer(base, np.uint8), (len(stamps_ns), 1))
    times = np.stack((stamps_ns // _SECOND, stamps_ns % _SECOND), axis=1).astype("<u4")
    rows[:, _STAMP] = times.view(np.uint8)
    rows[:, floats] = np.ascontiguousarray(values, "<f8").view(np.uint8)
    return rows.tobytes(), len(base)
