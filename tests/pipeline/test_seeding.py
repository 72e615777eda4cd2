"""What is drawn depends on seed and name alone, for ever."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.seeding import distinct, raw_words, uniforms
from recorders.errors import ConfigError

WORDS = ["0xaf1a0815ec6d3434", "0xf58d210f3d0e473b"]


def test_words_are_fixed_for_ever():
    """These are part of the file format: a controller's connections are drawn again from its seed."""
    assert [hex(word) for word in raw_words(0, "state", 3, count=2).tolist()] == WORDS
    assert uniforms(0, "state", 3, count=1)[0] == (int(WORDS[0], 16) >> 11) * 2.0**-53


@pytest.mark.parametrize("other", [(1, "a", 1), (0, "b", 1), (0, "a", 2), (0, "a", "1"), (0, "a1"), (0, "a", 1, 0)])
def test_every_name_has_its_own_numbers(other):
    assert not np.isin(uniforms(0, "a", 1, count=100), uniforms(*other, count=100)).any()


def test_a_longer_draw_begins_with_the_shorter():
    assert np.array_equal(uniforms(5, "x", count=10), uniforms(5, "x", count=1000)[:10])


def test_uniforms_fill_the_unit_interval_evenly():
    values = uniforms(7, "even", count=100_000)
    assert values.dtype == np.float64
    assert values.min() >= 0.0
    assert values.max() < 1.0
    assert np.abs(np.histogram(values, 10, (0, 1))[0] - 10_000).max() < 500  # five standard deviations


@given(st.integers(0, 60), st.integers(0, 60), st.integers(0, 2**64 - 1))
def test_distinct_numbers_are_distinct_sorted_and_in_range(count, more, seed):
    population = count + more
    chosen = distinct(raw_words(seed, "distinct", count=count), population)
    assert len(chosen) == count
    assert (np.diff(chosen) > 0).all()
    assert all(0 <= number < population for number in chosen)


def test_every_number_is_as_likely_as_any_other():
    words = raw_words(1, "fair", count=30_000).reshape(-1, 3)
    counts = np.bincount(np.concatenate([distinct(row, 10) for row in words]), minlength=10)
    assert np.abs(counts - 3000).max() < 250


def test_more_numbers_than_there_are_cannot_be_distinct():
    with pytest.raises(ConfigError, match="at most 2"):
        distinct(raw_words(0, "x", count=3), 2)
