"""Rate of the robot's clock: of the last seconds, of one clock, and nothing before enough was seen."""

import pytest

from pipeline.browser.session.clock_rate import ClockRate


def rates(*seen: tuple[float, float]) -> list[float | None]:
    """Return the rates by times of this machine [s] and of the robot [s]."""
    rate = ClockRate()
    return [rate.add(now_s, round(time_s * 1e9)) for now_s, time_s in seen]


def test_a_clock_has_a_rate_once_enough_was_seen():
    assert rates((10.0, 0.0), (11.0, 1.0)) == [None, None]
    assert rates((10.0, 0.0), (11.0, 1.0), (14.0, 2.0))[-1] == pytest.approx(0.5)


def test_what_is_long_ago_counts_no_more():
    slow, fast = [(float(s), 0.5 * s) for s in range(10)], [(10.0 + s, 5.0 + s) for s in range(10)]
    assert rates(*slow, *fast)[-1] == pytest.approx(1.0)


def test_a_clock_that_began_anew_is_another():
    assert rates((0.0, 50.0), (3.0, 53.0), (4.0, 0.0)) == [None, pytest.approx(1.0), None]
    rate = ClockRate()
    rate.add(0.0, 0)
    rate.clear()
    assert rate.add(9.0, 1) is None
