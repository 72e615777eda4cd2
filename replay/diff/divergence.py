"""The first message at which two logs part: which one, in which field, and what either log holds."""

from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import islice

from recorders.errors import CheckFailed
from recorders.messages.record import RecordedMessage
from replay.diff.alignment import Entry, LogAligner, Queues
from replay.diff.fields import ABSENT, FieldDifference
from replay.diff.rules import EXACT, Rules

CHANGED, MISSING, EXTRA, REORDERED = "changed", "missing", "extra", "reordered"


@dataclass(frozen=True, slots=True)
class Divergence:
    """A message that is not the same in two logs A and B.

    Parameters
    ----------
    topic : str
        Its topic.
    sequence : int
        The producer's number, as in A (in B if A lacks the message).
    stamp_ns : int or None
        The stamp of its header [ns], likewise; None if it has none.
    kind : str
        `changed`; `missing` from B; `extra` in B; `reordered`: both have it, at different places.
    field : str
        What differs: `pose.position.x`, `position[3] (left_elbow)`, `header.stamp`, `sequence`, `bytes[12]`, `message`
        if one log lacks it, `order`.
    a, b : str
        What either log holds there; floats in full precision.
    """

    topic: str
    sequence: int
    stamp_ns: int | None
    kind: str
    field: str
    a: str
    b: str

    def __str__(self) -> str:
        return self.between("A", "B")

    def between(self, a: str, b: str) -> str:
        """Return the divergence as one line, with names for the two logs."""
        stamp = "without a stamp" if self.stamp_ns is None else f"at {self.stamp_ns} ns"
        message = f"{self.topic} #{self.sequence} {stamp}"
        return f"{message} is {self.kind}: {self.field} is {self.a} in {a}, {self.b} in {b}"


def first_divergence(
    a: Iterable[RecordedMessage], b: Iterable[RecordedMessage], rules: Rules = EXACT
) -> Divergence | None:
    """Return the first message at which two logs part, None if they are the same.

    The learner's topics and the phase markers have one order, except that messages of one tick may come in any. Every
    other topic is compared on its own. Topic, type, sequence and bytes count, unless the rules leave something out; the
    time of recording does not.

    Parameters
    ----------
    a, b : iterable of RecordedMessage
        The logs, read as far as needed and never kept: memory grows with the skew between topics only.

    rules : Rules
        What counts as the same.

    Returns
    -------
    Divergence or None
        If several topics part, the earliest by cycle, stamp, rank of the topic, place in the log.
    """
    logs = LogAligner(a, b, rules)
    for _ in logs.read():
        pass
    return _earliest(logs)


def guard(stream: Iterable[RecordedMessage], recorded: Iterable[RecordedMessage]) -> Iterator[RecordedMessage]:
    """Yield the messages of a stream, in its order, for as long as they are those of a recorded run.

    What is yielded runs one tick behind what is read of the stream, as the messages of a tick may come in any order.

    Parameters
    ----------
    stream : iterable of RecordedMessage
        What is to be passed on.
    recorded : iterable of RecordedMessage
        What it must be, on all topics.

    Raises
    ------
    CheckFailed
        In place of the first message that differs, or where either side ends too early.
    """
    logs = LogAligner(recorded, stream)
    pending: deque[Entry] = deque()
    for entry in logs.read():
        pending.append(entry)
        yield from _agreed(pending)
    yield from _agreed(pending)
    divergence = _earliest(logs)
    if divergence is not None:
        raise CheckFailed(divergence.between("the recorded run", "this one"))


def _agreed(pending: deque[Entry]) -> Iterator[RecordedMessage]:
    while pending and pending[0].agreed:
        yield pending.popleft().record


def _earliest(logs: LogAligner) -> Divergence | None:
    found = [_judge(queues) for queues in logs.parted()]
    return min(found, key=lambda pair: pair[0].moment)[1] if found else None


def _judge(queues: Queues) -> tuple[Entry, Divergence]:
    """Classify a divergence of a channel from what follows in either log; return the message and the finding."""
    a, b = queues
    if not a or not b:
        return _missing(a[0], None) if a else _extra(b[0], None)
    x, y, after_x, after_y = a[0], b[0], _rest_of_cycle(a), _rest_of_cycle(b)
    lost = not any(map(x.same, after_y))
    new = not any(map(y.same, after_x))
    if not lost and not new:
        return _reordered(x, y)
    if lost and new and x.record.topic == y.record.topic:
        return _changed(x, y)
    if lost and (twin := _twin(x, after_y)):
        return _changed(x, twin)
    if new and (twin := _twin(y, after_x)):
        return _changed(twin, y)
    if not lost or (new and y.is_marker):
        return _extra(y, x)
    return _missing(x, y)


def _rest_of_cycle(queue: deque[Entry]) -> list[Entry]:
    """Return what follows the head, up to and with the next phase marker: the cycle after repeats the messages."""
    rest: list[Entry] = []
    if queue[0].is_marker:
        return rest
    for entry in islice(queue, 1, None):
        rest.append(entry)
        if entry.is_marker:
            break
    return rest


def _twin(entry: Entry, others: list[Entry]) -> Entry | None:
    """Return the one message with the same number; none where a foreign writer numbers nothing."""
    twins = [other for other in others if other.same_number(entry)]
    return twins[0] if len(twins) == 1 else None


def _changed(a: Entry, b: Entry) -> tuple[Entry, Divergence]:
    return a, _divergence(a, CHANGED, a.rules.difference(a.record, b.record))


def _missing(a: Entry, instead: Entry | None) -> tuple[Entry, Divergence]:
    return a, _divergence(a, MISSING, FieldDifference("message", "present", _absent(instead)))


def _extra(b: Entry, instead: Entry | None) -> tuple[Entry, Divergence]:
    return b, _divergence(b, EXTRA, FieldDifference("message", _absent(instead), "present"))


def _reordered(a: Entry, b: Entry) -> tuple[Entry, Divergence]:
    named = min(a, b, key=lambda entry: entry.moment)
    return named, _divergence(named, REORDERED, FieldDifference("order", _name(a), _name(b)))


def _divergence(entry: Entry, kind: str, difference: FieldDifference) -> Divergence:
    return Divergence(entry.record.topic, entry.record.sequence, entry.stamp_ns, kind, *difference)


def _absent(instead: Entry | None) -> str:
    return ABSENT if instead is None else f"{ABSENT} ({_name(instead)} in its place)"


def _name(entry: Entry) -> str:
    return f"{entry.record.topic} #{entry.record.sequence}"
