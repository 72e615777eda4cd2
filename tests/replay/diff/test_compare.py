"""The first message at which two logs part is named exactly, and nothing else is called a divergence."""

import itertools
import math
import struct
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from episodes import write_episode
from hypothesis import given, settings
from hypothesis import strategies as st

from recorders.cdr.codec import decode, encode, stamp_ns
from recorders.errors import CheckFailed
from recorders.messages.message_types import Float64MultiArray, JointState, PoseStamped, String
from recorders.messages.phase import Phase
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import LEFT_TARGET, RIGHT_TARGET, SAMPLE_JOINTS, SESSION_PHASE
from recorders.reading.reader import LogReader
from replay.diff import alignment
from replay.diff.divergence import Divergence, first_divergence, guard

TICKS, TOPICS_A_TICK = 9, 3
PLACES = st.integers(0, TICKS * TOPICS_A_TICK - 1)
NOISE = "/joint_commands"
examples = settings(max_examples=100, derandomize=True)  # the same in every run, on any machine


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> list[RecordedMessage]:
    path: Path = tmp_path_factory.mktemp("log") / "episode.mcap"
    return list(LogReader(write_episode(path, samples=TICKS - 1)))


def stamp_of(record: RecordedMessage) -> int:
    stamp = stamp_ns(record.type, record.data)
    assert stamp is not None
    return stamp


def cycles(log: Sequence[RecordedMessage], count: int = 3) -> list[RecordedMessage]:
    """The log presented several times, each time under a marker, as a replay does."""
    stream: list[RecordedMessage] = []
    for cycle in range(count):
        marker = encode(Phase("r", 0, cycle, "learn", "l").to_message())
        stream += [RecordedMessage(SESSION_PHASE, String.TYPE, marker, cycle, 0), *log]
    return stream


def with_float(record: RecordedMessage, place: int, value: float) -> RecordedMessage:
    """Change one float: of a pose's position, or of joint positions."""
    message = decode(record.type, record.data)
    assert isinstance(message, JointState | PoseStamped)
    numbers = message.position.copy()
    numbers[place % len(numbers)] = value
    return record._replace(data=encode(replace(message, position=numbers)))


def changed(record: RecordedMessage, place: int) -> tuple[RecordedMessage, str, float, float]:
    """Change one float by one unit in the last place; return its field and both values too."""
    message = decode(record.type, record.data)
    assert isinstance(message, JointState | PoseStamped)
    place %= len(message.position)
    old = float(message.position[place])
    new = math.nextafter(old, math.inf)
    if isinstance(message, JointState):
        field = f"position[{place}] ({message.name[place]})"
    else:
        field = f"pose.position.{'xyz'[place]}"
    return with_float(record, place, new), field, old, new


def stopped(stream: Sequence[RecordedMessage], recorded: Sequence[RecordedMessage]) -> list[RecordedMessage]:
    """What a guarded stream yields before it stops, which it must."""
    passed: list[RecordedMessage] = []
    with pytest.raises(CheckFailed) as caught:
        passed.extend(guard(stream, recorded))  # keeps what came before the error
    divergence = first_divergence(recorded, stream)
    assert divergence is not None
    assert str(caught.value) == divergence.between("the recorded run", "this one")
    assert caught.value.exit_status == 1
    return passed


def found(a: Sequence[RecordedMessage], b: Sequence[RecordedMessage]) -> Divergence:
    divergence = first_divergence(a, b)
    assert divergence is not None
    return divergence


def names(divergence: Divergence, record: RecordedMessage) -> bool:
    here = (divergence.topic, divergence.sequence, divergence.stamp_ns)
    return here == (record.topic, record.sequence, stamp_of(record))


@examples
@given(place=PLACES, cycle=st.integers(0, 2), element=st.integers(0, 14))
def test_one_changed_float(log: list[RecordedMessage], place: int, cycle: int, element: int) -> None:
    a, at = cycles(log), cycle * (len(log) + 1) + 1 + place
    other, field, old, new = changed(a[at], element)
    b = [*a[:at], other, *a[at + 1 :]]
    divergence = found(a, b)
    assert names(divergence, a[at])
    assert divergence == replace(divergence, kind="changed", field=field, a=repr(old), b=repr(new))
    assert stopped(b, a) == b[:at]


@examples
@given(place=PLACES, cycle=st.integers(0, 2))
def test_one_dropped(log: list[RecordedMessage], place: int, cycle: int) -> None:
    a, at = cycles(log), cycle * (len(log) + 1) + 1 + place
    b = [*a[:at], *a[at + 1 :]]
    divergence = found(a, b)
    assert names(divergence, a[at])
    assert (divergence.kind, divergence.a) == ("missing", "present")
    assert divergence.b.startswith("absent")
    assert stopped(b, a) == b[:at]
    assert (found(b, a).kind, found(b, a).b) == ("extra", "present")
    assert names(found(b, a), a[at])


@examples
@given(place=PLACES, later=st.integers(0, TICKS * TOPICS_A_TICK), cycle=st.integers(0, 2))
def test_one_repeated(log: list[RecordedMessage], place: int, later: int, cycle: int) -> None:
    """At once or any number of messages later in the cycle."""
    a, first = cycles(log), cycle * (len(log) + 1) + 1
    again = first + min(place + 1 + later, len(log))
    b = [*a[:again], a[first + place], *a[again:]]
    divergence = found(a, b)
    assert names(divergence, a[first + place])
    assert (divergence.kind, divergence.b) == ("extra", "present")


@examples
@given(places=st.tuples(PLACES, PLACES), cycle=st.integers(0, 2))
def test_two_swapped(log: list[RecordedMessage], places: tuple[int, int], cycle: int) -> None:
    a = cycles(log)
    one, two = (cycle * (len(log) + 1) + 1 + place for place in sorted(places))
    b = list(a)
    b[one], b[two] = a[two], a[one]
    if stamp_of(a[one]) == stamp_of(a[two]):
        assert first_divergence(a, b) is None
        assert list(guard(b, a)) == b
    else:
        divergence = found(a, b)
        assert names(divergence, a[one])
        assert (divergence.kind, divergence.field) == ("reordered", "order")
        assert stopped(b, a) == b[:one]


@examples
@given(place=PLACES, tick=st.integers(0, TICKS + 3))
def test_one_changed_stamp(log: list[RecordedMessage], place: int, tick: int) -> None:
    """Wherever the wrong stamp would bring the message."""
    record = log[place]
    message = decode(record.type, record.data)
    assert isinstance(message, JointState | PoseStamped)
    stamp = tick * 200_000_000
    if stamp == message.stamp_ns:
        return
    b = [*log[:place], record._replace(data=encode(replace(message, stamp_ns=stamp))), *log[place + 1 :]]
    divergence = found(log, b)
    assert names(divergence, record)
    assert (divergence.kind, divergence.field) == ("changed", "header.stamp")
    assert (divergence.a, divergence.b) == (str(message.stamp_ns), str(stamp))


@examples
@given(st.data())
def test_messages_of_one_tick_come_in_any_order(log: list[RecordedMessage], data: st.DataObject) -> None:
    ticks = [list(tick) for _, tick in itertools.groupby(log, stamp_of)]
    shuffled = list(itertools.chain.from_iterable(data.draw(st.permutations(tick)) for tick in ticks))
    assert first_divergence(cycles(log), cycles(shuffled)) is None
    assert list(guard(cycles(shuffled), cycles(log))) == cycles(shuffled)


@examples
@given(st.data())
def test_other_topics_interleave_as_they_like(log: list[RecordedMessage], data: st.DataObject) -> None:
    noise = [record._replace(topic=NOISE) for record in log if record.topic == SAMPLE_JOINTS]
    a = [*noise, *log]
    b = list(log)
    for record, place in zip(noise, sorted(data.draw(st.lists(PLACES, min_size=TICKS, max_size=TICKS))), strict=True):
        b.insert(place + len(b) - len(log), record)
    assert first_divergence(a, b) is None
    assert list(guard(b, a)) == b
    lost = data.draw(st.sampled_from(noise))
    assert names(found(a, [record for record in b if record is not lost]), lost)


def test_the_time_of_recording_does_not_enter(log: list[RecordedMessage]) -> None:
    later = [record._replace(log_time_ns=record.log_time_ns + 1) for record in log]
    assert first_divergence(log, later) is None


def test_the_earliest_of_several_is_named(log: list[RecordedMessage]) -> None:
    """By stamp, then rank, though the other log's topics come in another order."""
    noise = [record._replace(topic=NOISE) for record in log if record.topic == SAMPLE_JOINTS]
    bad_noise = [*noise[:3], with_float(noise[3], 0, 9.0), *noise[4:]]
    for place, topic in ((9, LEFT_TARGET), (10, RIGHT_TARGET), (12, NOISE)):
        bad = [*log[:place], with_float(log[place], 0, 9.0), *log[place + 1 :]]
        for a, b in (((*noise, *log), (*bad_noise, *bad)), ((*log, *noise), (*bad, *bad_noise))):
            assert found(a, b).topic == topic


def test_an_earlier_cycle_goes_before_an_earlier_stamp(log: list[RecordedMessage]) -> None:
    a = [record._replace(topic=NOISE) if record.topic == SAMPLE_JOINTS else record for record in cycles(log)]
    b = list(a)
    for at in (len(log) - 2, len(log) + 4):  # a target late in the first cycle, joints early in the second
        b[at] = with_float(a[at], 0, 9.0)
    assert (found(a, b).topic, found(a, b).stamp_ns) == (a[len(log) - 2].topic, stamp_of(a[len(log) - 2]))


@pytest.mark.parametrize("cycle", [0, 1, 2])
def test_a_marker(log: list[RecordedMessage], cycle: int) -> None:
    a, at = cycles(log), cycle * (len(log) + 1)
    without = [*a[:at], *a[at + 1 :]]
    other = RecordedMessage(
        SESSION_PHASE, String.TYPE, encode(Phase("r", 0, cycle, "evaluate", "l").to_message()), cycle, 0
    )
    assert found(a, without) == replace(found(a, without), topic=SESSION_PHASE, sequence=cycle, kind="missing")
    assert found(without, a) == replace(found(a, without), kind="extra", a=found(a, without).b, b="present")
    divergence = found(a, [*a[:at], other, *a[at + 1 :]])
    assert (divergence.topic, divergence.sequence, divergence.stamp_ns) == (SESSION_PHASE, cycle, None)
    assert (divergence.kind, divergence.field) == ("changed", "data")
    assert '"learn"' in divergence.a
    assert '"evaluate"' in divergence.b


@pytest.mark.parametrize("kept", [0, 1, 7, 26])
def test_either_side_ends_too_early(log: list[RecordedMessage], kept: int) -> None:
    assert names(found(log, log[:kept]), log[kept])
    assert found(log, log[:kept]).b == "absent"
    assert stopped(log[:kept], log) == log[:kept]
    assert stopped(log, log[:kept]) == log[:kept]


def test_a_changed_sequence_and_a_changed_type(log: list[RecordedMessage]) -> None:
    for change, field in (({"sequence": 77}, "sequence"), ({"type": "x/msg/Y"}, "type")):
        b = [*log[:7], log[7]._replace(**change), *log[8:]]
        assert (found(log, b).field, names(found(log, b), log[7])) == (field, True)


def test_bytes_that_do_not_decode(log: list[RecordedMessage]) -> None:
    b = [*log[:8], log[8]._replace(data=log[8].data[:40] + b"\xff" * 8), *log[9:]]
    divergence = found(log, b)
    assert names(divergence, log[8])
    assert divergence.field.startswith("bytes[")
    opaque = [RecordedMessage("/x", "", bytes([0, place]), place, 0) for place in range(4)]
    b = [*opaque[:2], opaque[2]._replace(data=b"\0"), opaque[3]]
    assert (
        str(found(opaque, b)) == "/x #2 without a stamp is changed: bytes[1] is 0x02 in A, the end after 1 bytes in B"
    )


def test_a_foreign_writer_that_numbers_nothing(log: list[RecordedMessage]) -> None:
    a = [record._replace(sequence=0) for record in log]
    assert (found(a, a[:7] + a[8:]).kind, found(a, a[:7] + a[8:]).stamp_ns) == ("missing", stamp_of(a[7]))
    b = [*a[:7], changed(a[7], 1)[0], *a[8:]]
    assert (found(a, b).kind, found(a, b).field) == ("changed", "pose.position.y")


def test_numbers_that_look_alike() -> None:
    odd = struct.unpack("<d", struct.pack("<Q", 0x7FF8000000000001))[0]
    rows = [np.array([1.0, number]) for number in (math.nan, odd, 0.0, -0.0)]
    records = [RecordedMessage("/x", Float64MultiArray.TYPE, encode(Float64MultiArray(row)), 0, 0) for row in rows]
    assert first_divergence(records[:1], records[:1]) is None
    alike = found(records[:1], records[1:2])
    assert (alike.field, alike.a, alike.b) == ("data[1]", "nan (0x7ff8000000000000)", "nan (0x7ff8000000000001)")
    assert (found(records[2:3], records[3:4]).a, found(records[2:3], records[3:4]).b) == ("0.0", "-0.0")


def test_the_line(log: list[RecordedMessage]) -> None:
    b = [*log[:6], with_float(log[6], 0, 0.1), *log[7:]]
    x = decode(log[6].type, log[6].data).position[0]
    line = f"/hand/left/target #2 at 400000000 ns is changed: pose.position.x is {float(x)!r} in A, 0.1 in B"
    assert str(found(log, b)) == line
    assert str(found(log, [*log[:6], *log[7:]])) == (
        "/hand/left/target #2 at 400000000 ns is missing: "
        "message is present in A, absent (/hand/right/target #2 in its place) in B"
    )


def test_a_long_text_is_shown_around_the_difference() -> None:
    texts = ["u" * 5000 + end + "v" * 5000 for end in ("a", "b")]
    a, b = ([RecordedMessage("/robot_description", String.TYPE, encode(String(text)), 0, 0)] for text in texts)
    assert (len(found(a, b).a) < 80, "ua" in found(a, b).a, "ub" in found(a, b).b) == (True, True, True)


def test_no_more_is_read_than_needed(log: list[RecordedMessage]) -> None:
    """Both logs run for ever, and one lacks a single message."""
    endless = itertools.count()
    a = (RecordedMessage("/x", "", b"", number, 0) for number in endless)
    b = (RecordedMessage("/x", "", b"", number, 0) for number in itertools.count() if number != 5)
    assert found(a, b) == Divergence("/x", 5, None, "missing", "message", "present", "absent (/x #6 in its place)")
    assert next(endless) < 2 * alignment.LOOKAHEAD


def test_a_topic_that_only_one_log_has_does_not_fill_the_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(alignment, "MAX_SKEW", 100)
    monkeypatch.setattr(alignment, "LOOKAHEAD", 50)
    kept: list[int] = []

    def log(topics: Sequence[str]) -> Iterator[RecordedMessage]:
        for number in itertools.count():
            kept.append(number)
            yield from (RecordedMessage(topic, "", b"", number, 0) for topic in topics)

    divergence = first_divergence(log(["/x", "/y"]), log(["/x", "/x2"]))
    assert divergence is not None
    assert (divergence.topic, divergence.sequence, divergence.kind) == ("/y", 0, "missing")
    assert len(kept) < 1000


def test_a_topic_may_lag_within_the_skew(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(alignment, "MAX_SKEW", 10)
    x = [RecordedMessage("/x", "", b"", number, 0) for number in range(40)]
    y = [RecordedMessage("/y", "", b"", number, 0) for number in range(40)]
    assert first_divergence(x + y, y + x) is None
