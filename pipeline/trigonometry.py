"""Sine and cosine in a fixed order of IEEE operations: the same bits whatever libm, numpy or processor there is."""

import math

import numpy as np
from numpy.typing import ArrayLike

from pipeline.arrays import Floats
from recorders.errors import ConfigError

MOST_TURNED_RAD = 1e6
"""Beyond this angle, what is left over of whole quarter turns would no longer be exact."""

# A quarter turn in three parts: the first two have 33 bits, so that up to 2^20 times them is exact.
_QUARTER = tuple(map(float.fromhex, ("0x1.921fb544p+0", "0x1.0b4611a6p-34", "0x1.3198a2e037073p-69")))
_QUARTERS_PER_RAD = float.fromhex("0x1.45f306dc9c883p-1")

# Taylor series about 0; at an eighth of a turn the next term of either is below 1e-18.
_SINE = [(-1) ** n / math.factorial(2 * n + 1) for n in range(1, 9)]
_COSINE = [(-1) ** n / math.factorial(2 * n) for n in range(1, 10)]


def sine(angles: ArrayLike) -> Floats:
    """Return the sine of angles [rad], to 1e-16; raises ConfigError beyond `MOST_TURNED_RAD`.

    Examples
    --------
    >>> sine([0.0, 0.5]).tolist()
    [0.0, 0.479425538604203]
    """
    return _turned(angles, quarters=0)


def cosine(angles: ArrayLike) -> Floats:
    """Return the cosine of angles [rad], to 1e-16; raises ConfigError beyond `MOST_TURNED_RAD`."""
    return _turned(angles, quarters=1)


def sine_and_cosine(angles: ArrayLike) -> Floats:
    """Return `sine` and `cosine` of angles [rad] of any shape, along a new first axis, at the price of one."""
    turned = np.asarray(angles, dtype=np.float64)
    return _turned(turned, quarters=np.arange(2.0).reshape(2, *(1,) * turned.ndim))


def _turned(angles: ArrayLike, *, quarters: int | Floats) -> Floats:
    """Return the sine of angles [rad] that are turned on by some quarters of a turn."""
    turned = np.asarray(angles, dtype=np.float64)
    if not (np.abs(turned) <= MOST_TURNED_RAD).all():  # nor is NaN
        raise ConfigError(f"expected angles within {MOST_TURNED_RAD:g} rad, found {turned.ravel()[:4].tolist()}")
    whole = np.rint(turned * _QUARTERS_PER_RAD)
    rest = turned
    for part in _QUARTER:
        rest = rest - whole * part
    squared = rest * rest
    sines, cosines = rest + rest * _series(_SINE, squared), 1.0 + _series(_COSINE, squared)
    quadrant = whole + quarters
    quadrant = quadrant - 4.0 * np.floor(quadrant / 4.0)  # 0, 1, 2 or 3
    magnitude = np.where((quadrant == 1.0) | (quadrant == 3.0), cosines, sines)
    return np.where(quadrant >= 2.0, -magnitude, magnitude)


def _series(coefficients: list[float], squared: Floats) -> Floats:
    """Sum of the terms of a series from the second on, the last first: c1 x^2 + c2 x^4 + ..."""
    total = np.zeros_like(squared)
    for coefficient in reversed(coefficients):
        total = (total + coefficient) * squared
    return total
