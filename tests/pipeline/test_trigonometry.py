"""Sine and cosine are right to the last bit or two, and have bits of their own, whatever computes others'."""

import hashlib
import math

import numpy as np
import pytest

from pipeline.trigonometry import MOST_TURNED_RAD, cosine, sine
from recorders.errors import ConfigError


@pytest.mark.parametrize("most", [1e-3, 1.0, 100.0, MOST_TURNED_RAD])
def test_they_are_sine_and_cosine(most: float) -> None:
    angles = np.random.default_rng(0).uniform(-most, most, 20_000)
    expected = np.array([[math.sin(angle), math.cos(angle)] for angle in angles.tolist()])
    np.testing.assert_allclose(sine(angles), expected[:, 0], rtol=0, atol=3e-16)
    np.testing.assert_allclose(cosine(angles), expected[:, 1], rtol=0, atol=3e-16)


def test_quarters_of_a_turn_are_as_libm_has_them() -> None:
    quarters = np.arange(-8, 9) * (np.pi / 2.0)
    np.testing.assert_allclose(sine(quarters), np.sin(quarters), rtol=1e-15, atol=0)
    np.testing.assert_array_equal(sine(quarters)[1::2], [-1.0, 1.0, -1.0, 1.0, -1.0, 1.0, -1.0, 1.0][::-1])
    np.testing.assert_array_equal(cosine([0.0]), [1.0])


def test_their_bits_are_these() -> None:
    """Every operation is one that IEEE 754 fixes, in an order that is fixed here."""
    angles = (np.arange(20_001) - 10_000.0) / 64.0
    digest = hashlib.sha256(np.stack([sine(angles), cosine(angles)]).astype("<f8").tobytes()).hexdigest()
    assert digest[:16] == "4ff043f993c54ad7"


@pytest.mark.parametrize("angle", [2.0 * MOST_TURNED_RAD, -np.inf, np.nan])
def test_beyond_what_they_are_made_for_is_an_error(angle: float) -> None:
    with pytest.raises(ConfigError, match=r"expected angles within 1e\+06 rad, found"):
        sine([0.5, angle])
