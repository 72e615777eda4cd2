"""Slope of a series, robustly, with its confidence: whether something grows."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.stats import theilslopes

_BLOCKS = 24  # neighbouring samples of memory depend on one another; medians of so long blocks hardly do
_CONFIDENCE = 0.99


class Slope(NamedTuple):
    """Slope of a series in its unit a second, and the ends of its 99 % confidence interval."""

    slope: float
    low: float
    high: float

    @property
    def is_zero(self) -> bool:
        """Whether zero is in the interval."""
        return self.low <= 0.0 <= self.high


def robust_slope(times_s: ArrayLike, values: ArrayLike) -> Slope:
    """Return the slope after Theil and Sen over the medians of equal blocks of samples.

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
        If there are fewer samples than blocks.
    """
    times, series = np.asarray(times_s, dtype=np.float64), np.asarray(values, dtype=np.float64)
    if len(times) < _BLOCKS:
        raise ValueError(f"expected at least {_BLOCKS} samples, found {len(times)}")
    blocks = [
        (np.median(block_times), np.median(block))
        for block_times, block in zip(np.array_split(times, _BLOCKS), np.array_split(series, _BLOCKS), strict=True)
    ]
    block_times, medians = np.array(blocks).T
    found = theilslopes(medians, block_times, alpha=_CONFIDENCE)
    return Slope(float(found.slope), float(found.low_slope), float(found.high_slope))
