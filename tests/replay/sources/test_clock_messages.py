"""`/clock` in a playback: multiples of a period in log time, and never a message before its time."""

from collections.abc import Sequence
from pathlib import Path

import pytest
from episodes import PERIOD_NS, write_episode
from hypothesis import given, settings
from hypothesis import strategies as st

from recorders.cdr.codec import decode_as
from recorders.errors import ConfigError, LogError
from recorders.messages.message_types import Clock
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import CLOCK
from recorders.messages.validation import MAX_STAMP_NS
from recorders.reading.reader import LogReader
from recorders.rmw_zenoh.qos import Qos
from recorders.writing.writer import LogWriter
from replay.sources.clock_messages import with_clock
from replay.sources.playback import Playback, PlaybackConfig


def stream(times_ns: Sequence[int]) -> list[RecordedMessage]:
    return [RecordedMessage("/a", "", b"", number, time_ns) for number, time_ns in enumerate(times_ns)]


@settings(max_examples=20)
@given(times_ns=st.lists(st.integers(0, 500), max_size=9), period_ns=st.integers(7, 300))
def test_time_is_there_before_every_message_and_never_ahead_of_it(times_ns: list[int], period_ns: int) -> None:
    messages = stream(times_ns)
    found = list(with_clock(iter(messages), period_ns))
    assert [record for record in found if record.topic != CLOCK] == messages
    now_ns: int | None = None
    for record in found:
        if record.topic == CLOCK:
            now_ns = decode_as(Clock, record.data).clock_ns
            assert (record.log_time_ns, now_ns % period_ns) == (now_ns, 0)
        else:
            assert now_ns is not None
            assert 0 <= record.log_time_ns - now_ns < period_ns
    assert [record.sequence for record in found if record.topic == CLOCK] == list(range(len(found) - len(messages)))


@pytest.mark.parametrize(
    ("times_ns", "clocks_ns"),
    [
        ([250, 450, 200], [200, 300, 400, 200]),
        ([250, 250, 450], [200, 300, 400]),
        ([200, 200], [200]),
        ([0, 0, 250], [0, 100, 200]),
    ],
)
def test_every_multiple_is_there_once_and_a_stream_that_begins_anew_has_a_clock_that_does(
    times_ns: list[int], clocks_ns: list[int]
) -> None:
    found = with_clock(iter(stream(times_ns)), 100)
    assert [record.log_time_ns for record in found if record.topic == CLOCK] == clocks_ns


def test_the_log_time_replaces_a_recorded_clock(tmp_path: Path) -> None:
    path = write_episode(tmp_path / "log.mcap", samples=3)
    with LogWriter(tmp_path / "clock.mcap", manifest={}) as log:
        log.write(CLOCK, Clock(77), log_time_ns=PERIOD_NS)
    playback = Playback([path, tmp_path / "clock.mcap"], PlaybackConfig(clock_period_ns=PERIOD_NS // 2))
    found = list(playback.stream())
    assert [record for record in found if record.topic != CLOCK] == list(LogReader(path))
    assert 77 not in [decode_as(Clock, record.data).clock_ns for record in found if record.topic == CLOCK]
    clocks = [record.log_time_ns for record in found if record.topic == CLOCK]
    assert clocks == list(range(0, found[-1].log_time_ns + 1, PERIOD_NS // 2))
    assert (CLOCK in {channel.topic for channel in playback.channels}, playback.qos[CLOCK]) == (True, Qos(depth=1))
    assert playback.offer().messages is None


def test_times_that_ros_cannot_hold_are_refused_at_the_start(tmp_path: Path) -> None:
    with LogWriter(tmp_path / "late.mcap", manifest={}) as log:
        log.write("/a", b"", log_time_ns=2**63, opaque=True)
    assert list(Playback([tmp_path / "late.mcap"]).stream())
    with pytest.raises(LogError, match=r"/a #0: expected a log time that /clock can hold, up to .*without --clock"):
        Playback([tmp_path / "late.mcap"], PlaybackConfig(clock_period_ns=1))
    with LogWriter(tmp_path / "last.mcap", manifest={}) as log:
        log.write("/a", b"", log_time_ns=MAX_STAMP_NS, opaque=True)
    clock, last = Playback([tmp_path / "last.mcap"], PlaybackConfig(clock_period_ns=10**9)).stream()
    assert (decode_as(Clock, clock.data).clock_ns, last.log_time_ns) == (MAX_STAMP_NS // 10**9 * 10**9, MAX_STAMP_NS)
    with pytest.raises(ConfigError, match="clock: expected a period"):
        PlaybackConfig(clock_period_ns=0)
