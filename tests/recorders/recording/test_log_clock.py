"""The log time of a recording never falls, and a clock that steps back is said once."""

import pytest

from recorders.recording.log_clock import LogClock

DAY_NS = 86_400 * 10**9
NOW_NS = 1_700_000_000_000_000_001  # no float64 holds it


def test_log_time_waits_for_a_clock_that_steps_back_and_it_is_said_once_each_time(
    caplog: pytest.LogCaptureFixture,
) -> None:
    times = [
        NOW_NS,
        NOW_NS + 5,
        NOW_NS - DAY_NS,
        NOW_NS - DAY_NS + 7,
        0,
        NOW_NS + 5,
        NOW_NS + 6,
        NOW_NS + 4,
        NOW_NS + 9,
    ]
    readings = iter(times)
    clock = LogClock(lambda: next(readings))
    later = NOW_NS + 5
    assert [clock.now_ns() for _ in times] == [
        NOW_NS,
        later,
        later,
        later,
        later,
        later,
        later + 1,
        later + 1,
        later + 4,
    ]
    assert caplog.messages == [
        "the clock on the wall stepped back by 86400 s: log time waits until it has caught up",
        "the clock on the wall stepped back by 2e-09 s: log time waits until it has caught up",
    ]


def test_times_beyond_what_a_float_holds_stay_whole() -> None:
    for time_ns in (NOW_NS, 2**63 + 1, 2**64 - 1):
        assert LogClock(lambda now_ns=time_ns: now_ns).now_ns() == time_ns  # type: ignore[misc]
