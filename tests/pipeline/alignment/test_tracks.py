"""Samples about a tick, the values between them, and where ticks may be, are those of plain Python, tick by tick."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from plain_alignment import WAIT_NS, PlainTrack, _at

from pipeline.alignment.ticks import _multiples
from pipeline.alignment.track import NEVER, Track

TIMES = st.lists(st.integers(0, 60), max_size=12, unique=True).map(sorted)


@st.composite
def tracks(draw: Any, *, turns: bool) -> tuple[Track, PlainTrack]:
    """Return a track of some samples, which came in parts, and the same plainly."""
    stamps, rng = draw(TIMES), np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    values = rng.normal(size=(len(stamps), 7))
    values[:, 3:] /= np.sqrt((values[:, 3:] ** 2).sum(axis=1, keepdims=True))
    ahead = [draw(st.sampled_from([NEVER, 0, 30, WAIT_NS, WAIT_NS + 20, WAIT_NS + 40])) for _ in stamps]
    track, plain, cut = Track(7, turns=turns), PlainTrack(), draw(st.integers(0, len(stamps)))
    for part in (slice(None, cut), slice(cut, None)):
        track.add(np.array(stamps[part], np.int64), values[part], np.array(ahead[part], np.int64))
    plain.stamps, plain.values, plain.ahead = stamps, values.tolist(), ahead
    return track, plain


def check_against_the_plain_version(track: Track, plain: PlainTrack, first: int, tolerance: int, turns: bool) -> None:
    ticks = np.arange(first, 63)
    expected = [_at(plain, tick, tolerance, turns) for tick in ticks.tolist()]
    span = track.span(ticks, tolerance)
    assert span.near.tolist() == [found is not None for found in expected]
    near = type(span)(span.before[span.near], span.after[span.near], span.near[span.near])
    made = track.between(ticks[span.near], near)
    known = [found for found in expected if found is not None]
    assert made.shape == (len(known), 7)
    np.testing.assert_allclose(made, np.array(known).reshape(-1, 7), rtol=0, atol=1e-14)
    for row, tick, found in zip(made, ticks[span.near].tolist(), known, strict=True):
        if tick in plain.stamps:
            assert row.tolist() == found  # at a sample they are its own, to the bit


@pytest.mark.parametrize("turns", [True, False])
@settings(max_examples=40)
@given(data=st.data(), tolerance=st.integers(0, 20), at=st.integers(0, 60))
def test_ticks_of_a_track_are_those_of_the_plain_version(turns: bool, data: Any, tolerance: int, at: int) -> None:
    """Also once what no later tick can need is forgotten."""
    track, plain = data.draw(tracks(turns=turns))
    assert track.last_ns == (plain.stamps[-1] if plain.stamps else NEVER)
    check_against_the_plain_version(track, plain, 0, tolerance, turns)
    track.forget_before(at)
    check_against_the_plain_version(track, plain, at + 1, tolerance, turns)
    later = [stamp for stamp in plain.stamps if stamp > at]
    assert len(track.stamps_ns) == len(later) + (len(later) < len(plain.stamps))


@settings(max_examples=80)
@given(TIMES, st.integers(1, 15), st.integers(0, 15), st.integers(-40, 60), st.integers(0, 80))
def test_multiples_of_a_period_lie_between_samples_that_are_near_or_at_one(
    stamps: list[int], period: int, tolerance: int, after: int, limit: int
) -> None:
    """In a hole of any length there is none, so that none fills the memory."""
    pairs = list(zip([None, *stamps], stamps, strict=False))
    expected = [
        time
        for time in range(0, 81)
        if time % period == 0
        and after < time <= limit
        and any(
            time == late or (early is not None and early < time < late and late - early <= 2 * tolerance)
            for early, late in pairs
        )
    ]
    assert _multiples(np.array(stamps, np.int64), period, tolerance, after, limit).tolist() == expected


@pytest.mark.parametrize(("at", "kept"), [(-1, [0, 10, 20]), (9, [0, 10, 20]), (10, [10, 20]), (25, [20])])
def test_the_last_sample_before_a_tick_is_kept_and_none_before_it(at: int, kept: list[int]) -> None:
    track = Track(1, turns=False)
    track.add(np.array([0, 10, 20]), np.zeros((3, 1)), np.zeros(3, np.int64))
    track.forget_before(at)
    assert track.stamps_ns.tolist() == kept
