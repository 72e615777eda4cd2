"""The contract of every clock: it delays, it never drops or reorders."""

import threading
import time
from collections.abc import Iterator

import pytest
from waiting import wait_until

from recorders.errors import ConfigError
from recorders.messages.record import RecordedMessage
from replay.transports.clock import Clock, Paced, Pausable, Unpaced, paced

CLOCKS = {"unpaced": Unpaced, "paced": lambda: Paced(1000.0), "pausable": lambda: Pausable(Paced(1000.0))}


def stream(count: int, *, period_ns: int = 1_000_000, cycles: int = 1) -> Iterator[RecordedMessage]:
    for _ in range(cycles):
        for index in range(count):
            yield RecordedMessage("/t", "t", b"", index, index * period_ns)


@pytest.mark.parametrize("make", CLOCKS.values(), ids=CLOCKS)
def test_everything_passes_in_order(make: type[Clock]) -> None:
    assert list(paced(stream(50, cycles=3), make())) == list(stream(50, cycles=3))


def test_it_is_never_early() -> None:
    began = time.monotonic()
    list(paced(stream(11, period_ns=20_000_000), Paced(2.0)))
    assert time.monotonic() - began >= 10 * 0.020 / 2.0


class PretendedTime:
    """Stands in for the `time` that a clock reads and sleeps by: it passes only when somebody lets it."""

    def __init__(self) -> None:
        self.now_ns = 0
        self.longest_s = 0.0

    def monotonic_ns(self) -> int:
        return self.now_ns

    def sleep(self, seconds: float) -> None:
        self.now_ns += round(seconds * 1e9)
        self.longest_s = max(self.longest_s, seconds)


@pytest.fixture
def pretended(monkeypatch: pytest.MonkeyPatch) -> PretendedTime:
    pretended = PretendedTime()
    monkeypatch.setattr("replay.transports.clock.time", pretended)
    return pretended


def test_a_cycle_that_begins_anew_is_due_at_once(pretended: PretendedTime) -> None:
    list(paced(stream(2, period_ns=10_000_000, cycles=5), Paced(1.0)))
    assert pretended.now_ns == 5 * 10_000_000


def test_a_held_up_stream_slips_and_says_so(pretended: PretendedTime) -> None:
    clock = Paced(1.0)
    for number, _ in enumerate(paced(stream(4, period_ns=10_000_000), clock)):
        if number == 1:
            pretended.now_ns += 100_000_000
    assert clock.slipped_s == 0.09


def test_a_long_gap_is_waited_out_in_short_sleeps(monkeypatch: pytest.MonkeyPatch) -> None:
    """A signal that comes just before a sleep begins does not end it."""
    pretended = PretendedTime()
    monkeypatch.setattr("replay.transports.clock.time", pretended)
    clock = Paced(0.5)
    clock.wait(0)
    clock.wait(1000 * 10**9)
    assert (pretended.now_ns, clock.slipped_s) == (2000 * 10**9, 0.0)
    assert 0.0 < pretended.longest_s <= 0.5


def test_a_pause_is_no_slip_and_what_follows_keeps_its_distances(monkeypatch: pytest.MonkeyPatch) -> None:
    pretended = PretendedTime()
    monkeypatch.setattr("replay.transports.clock.time", pretended)
    pace = Paced(1.0)
    clock = Pausable(pace)

    def pass_five_seconds(condition: threading.Condition, timeout: float) -> bool:
        pretended.now_ns += 5_000_000_000
        clock.toggle()
        return True

    monkeypatch.setattr(threading.Condition, "wait", pass_five_seconds)
    clock.wait(0)
    clock.toggle()
    clock.wait(1_000_000_000)
    assert pretended.now_ns == 6_000_000_000
    clock.wait(2_000_000_000)
    assert (pretended.now_ns, pace.slipped_s) == (7_000_000_000, 0.0)
    pretended.now_ns += 1_500_000_000
    clock.wait(3_000_000_000)
    assert (pretended.now_ns, pace.slipped_s) == (8_500_000_000, 0.5)


@pytest.mark.parametrize("rate", [0.0, -1.0, 0.05, 1001.0, float("nan"), float("inf")])
def test_a_rate_out_of_range_is_refused(rate: float) -> None:
    with pytest.raises(ConfigError, match=r"0\.1 to 1000"):
        Paced(rate)


def test_a_person_can_stop_step_and_go_on() -> None:
    clock, passed = Pausable(Unpaced()), list[int]()
    clock.toggle()
    thread = threading.Thread(
        target=lambda: passed.extend(m.sequence for m in counted(paced(stream(6), clock), passed))
    )
    thread.start()
    for expected in (1, 2):
        clock.step()
        wait_until(lambda expected=expected: len(passed) == expected)  # type: ignore[misc]  # had it not stood still, it would be more
    clock.toggle()
    thread.join(60.0)
    assert not thread.is_alive()
    assert passed == [0, 1, 2, 3, 4, 5]


def counted(messages: Iterator[RecordedMessage], passed: list[int]) -> Iterator[RecordedMessage]:
    """Note each message as it passes; yields none of them again."""
    for message in messages:
        passed.append(message.sequence)
    yield from ()


@pytest.mark.parametrize("began_ns", [0, 1_790_000_000_123_456_789, 2**64 - 10**9])
@pytest.mark.parametrize("rate", [1.0, 3.0, 1000.0])
def test_distances_are_kept_to_the_nanosecond(monkeypatch: pytest.MonkeyPatch, began_ns: int, rate: float) -> None:
    """However long ago the machine started, and whatever the times of the log are."""
    pretended = PretendedTime()
    pretended.now_ns = started_ns = 2**60 + 1
    monkeypatch.setattr("replay.transports.clock.time", pretended)
    monkeypatch.setattr(pretended, "sleep", lambda seconds: setattr(pretended, "now_ns", pretended.now_ns + 1))
    clock = Paced(rate)
    for step in range(3001):
        clock.wait(began_ns + step)
    assert pretended.now_ns - started_ns == 3000 // rate


def test_a_wait_of_a_minute_or_more_is_said(monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture) -> None:
    pretended = PretendedTime()
    monkeypatch.setattr("replay.transports.clock.time", pretended)
    monkeypatch.setattr(pretended, "sleep", lambda seconds: setattr(pretended, "now_ns", pretended.now_ns + 2**60))
    clock = Paced(2.0)
    for time_ns in (0, 119 * 10**9, 1_790_000_000_123_456_789, 0, 5):
        clock.wait(time_ns)
    gap = "1789999881.123456789"
    assert caplog.messages == [f"the next message comes in 894999940 s: the recording has a gap of {gap} s before it"]
