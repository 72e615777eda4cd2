"""Slopes of a series, robustly, with their confidence: whether something grows."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.stats import theilslopes

_BLOCKS = 24  # neighbouring samples of memory depend on one another; blocks so long hardly do
_CONFIDENCE = 0.99
_BEYOND = 5  # of 24 slopes that are as often below a value as above it, so many at most are below in 0.33 % of cases
_LEAST = 3 * _BLOCKS


class Slope(NamedTuple):
    """Slope of a series in its unit a second, and the ends of its 99 % confidence interval."""

    slope: float
    low: float
    high: float


def overall_slope(times_s: ArrayLike, values: ArrayLike) -> Slope:
    """Return the slope after Theil and Sen over the medians of equal blocks of samples: from end to end.

    Parameters
    ----------
    times_s : array_like, shape (n,)
        Times [s], rising.
    values : array_like, shape (n,)
        The series.

    Returns
    -------
    Slope
        Median of the slopes between all pairs of blocks, with Sen's interval (J. Am. Stat. Assoc. 63, 1968).

    Raises
    ------
    ValueError
        If there are too few samples.
    """
    medians = [(np.median(block_times), np.median(block)) for block_times, block in _blocks(times_s, values)]
    block_times, blocks = np.array(medians).T
    found = theilslopes(blocks, block_times, alpha=_CONFIDENCE)
    return Slope(float(found.slope), float(found.low_slope), float(found.high_slope))


def steady_slope(times_s: ArrayLike, values: ArrayLike) -> Slope:
    """Return the slope within blocks of samples: steps between levels, in a few of them, count for nothing.

    A process takes more memory for good when the machine stalls and messages wait: a step. A leak grows in every block.

    Parameters
    ----------
    times_s : array_like, shape (n,)
        Times [s], rising.
    values : array_like, shape (n,)
        The series.

    Returns
    -------
    Slope
        Median of the slopes of all blocks, each after Theil and Sen, with the interval of the sign test.

    Raises
    ------
    ValueError
        If there are too few samples.
    """
    slopes = sorted(theilslopes(block, block_times).slope for block_times, block in _blocks(times_s, values))
    return Slope(float(np.median(slopes)), float(slopes[_BEYOND]), float(slopes[-1 - _BEYOND]))


def _blocks(times_s: ArrayLike, values: ArrayLike) -> list[tuple[np.ndarray, np.ndarray]]:
    times, series = np.asarray(times_s, dtype=np.float64), np.asarray(values, dtype=np.float64)
    if len(times) < _LEAST:
        raise ValueError(f"expected at least {_LEAST} samples, found {len(times)}")
    return list(zip(np.array_split(times, _BLOCKS), np.array_split(series, _BLOCKS), strict=True))
