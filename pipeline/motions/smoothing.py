"""Smoothing and resampling of paths that people show: trackers are noisy, and their stamps uneven."""

import numpy as np
from scipy.interpolate import PchipInterpolator
from scipy.signal import savgol_filter

from pipeline.arrays import Floats

_DEGREE = 3  # of the polynomials: a minimum-jerk movement has the fifth, and is nearly of the third in a window
_LEAST = _DEGREE + 2  # samples in a window: with fewer nothing would change
_MOST = 1_000_000  # samples of the even grid, whatever the stamps are


def smoothed(times_s: Floats, points: Floats, window_s: float) -> tuple[Floats, Floats, float]:
    """Smooth a path by polynomials of the third degree, each fitted to a window of time about its sample.

    The path is first resampled evenly, at the middle one of its own periods.

    Parameters
    ----------
    times_s : array, shape (N,)
        Rising times [s].
    points : array, shape (N, D)
        The path.
    window_s : float
        Length of the window [s].

    Returns
    -------
    (ndarray, ndarray, float)
        Even times [s], shape (M,), the path there, shape (M, D), and the length of the window that was used [s]; 0, and
        the path as it was, where a window holds fewer than five samples.

    Source: A. Savitzky, M. J. E. Golay, "Smoothing and differentiation of data by simplified least squares
    procedures", 1964, doi:10.1021/ac60214a047.
    """
    span_s = float(times_s[-1] - times_s[0])
    period_s = max(float(np.median(np.diff(times_s))), span_s / _MOST)
    count = round(span_s / period_s) + 1
    window = min(2 * (round(window_s / period_s) // 2) + 1, count - 1 + count % 2)  # odd
    if window < _LEAST:
        return times_s, points, 0.0
    even_s = np.linspace(times_s[0], times_s[-1], count)
    smooth = savgol_filter(resampled(times_s, points, even_s), window, _DEGREE, axis=0, mode="interp")
    return even_s, smooth, (window - 1) * span_s / (count - 1)


def resampled(times_s: Floats, points: Floats, at_s: Floats) -> Floats:
    """Return a path, times (N,) and points (N, D), at other times within it, shape (T, D): smooth, and never beyond.

    Source: F. N. Fritsch, R. E. Carlson, "Monotone piecewise cubic interpolation", 1980, doi:10.1137/0717021.
    """
    found: Floats = PchipInterpolator(times_s, points)(at_s)
    return found


def peak_jerk(points: Floats, period_s: float) -> float:
    """Return the largest third difference quotient of points (T, ..., D), `period_s` [s] apart; 0 of fewer than 4."""
    if len(points) <= _DEGREE:
        return 0.0
    return float(np.linalg.norm(np.diff(points, n=3, axis=0), axis=-1).max() / period_s**3)
