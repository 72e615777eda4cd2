"""The stream digest depends on what was sent and in which order, and on nothing else."""

import hashlib
import struct

from recorders.messages.record import RecordedMessage
from replay.sources.stream_digest import StreamDigest, frame_for_digest

TICK = [RecordedMessage("/a", "t", b"1", 0, 5), RecordedMessage("/b", "t", b"2", 0, 6)]


def digest(*ticks: list[RecordedMessage]) -> str:
    stream = StreamDigest()
    for tick in ticks:
        stream.update(tick)
    return stream.hexdigest()


def test_log_times_do_not_enter() -> None:
    later = [record._replace(log_time_ns=record.log_time_ns + 1) for record in TICK]
    assert digest(TICK) == digest(later)


def test_everything_else_does() -> None:
    changed = [
        [TICK[0]._replace(topic="/c"), TICK[1]],
        [TICK[0]._replace(sequence=1), TICK[1]],
        [TICK[0]._replace(data=b"3"), TICK[1]],
        TICK[::-1],
        TICK[:1],
        [],
    ]
    digests = {digest(tick) for tick in [TICK, *changed]}
    assert len(digests) == 1 + len(changed)


def test_how_ticks_are_cut_enters() -> None:
    assert digest(TICK) != digest(TICK[:1], TICK[1:])


def test_framing_is_unambiguous() -> None:
    assert frame_for_digest(RecordedMessage("/ab", "t", b"c", 0, 0)) != frame_for_digest(
        RecordedMessage("/a", "t", b"bc", 0, 0)
    )


def test_it_goes_on_from_its_value() -> None:
    first = StreamDigest()
    first.update(TICK)
    second = StreamDigest(first.value)
    second.update(TICK)
    assert second.hexdigest() == digest(TICK, TICK)


def test_every_link_hashes_the_digest_before_it_and_nothing_but_the_frames_of_its_messages() -> None:
    """Worked out by hand: 32 zeros before the first link; a frame is three lengths, the topic and the bytes."""
    frames = [struct.pack("<HII", 2, record.sequence, 1) + record.topic.encode() + record.data for record in TICK]
    first = hashlib.sha256(bytes(32) + frames[0] + frames[1]).digest()
    assert digest(TICK) == first.hex()
    assert digest(TICK, TICK[:1]) == hashlib.sha256(first + frames[0]).hexdigest()
