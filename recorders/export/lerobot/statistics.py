"""Statistics of a column, as LeRobot keeps them: of each of its numbers, the same on every machine."""

from math import fsum, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

QUANTILES = {"q01": 0.01, "q10": 0.10, "q50": 0.50, "q90": 0.90, "q99": 0.99}
"""Their names in a dataset, and which they are."""


def statistics(values: NDArray[Any]) -> dict[str, list[float] | list[int]]:
    """Return least, greatest, mean, standard deviation, count and quantiles of each of some numbers.

    Sums are exact before they are rounded; quantiles lie on the straight line between the values about them.

    Parameters
    ----------
    values : ndarray, shape (n, size)
        At least one row.
    """
    columns = [sorted(column) for column in values.T.astype(np.float64).tolist()]
    whole = np.issubdtype(values.dtype, np.integer)
    means = [fsum(column) / len(column) for column in columns]
    return {
        "min": [int(column[0]) if whole else column[0] for column in columns],
        "max": [int(column[-1]) if whole else column[-1] for column in columns],
        "mean": means,
        "std": [_deviation(column, mean) for column, mean in zip(columns, means, strict=True)],
        "count": [len(values)],
        **{name: [_quantile(column, part) for column in columns] for name, part in QUANTILES.items()},
    }


def _deviation(column: list[float], mean: float) -> float:
    """Return the standard deviation of all there are, as LeRobot takes it."""
    return sqrt(fsum((value - mean) * (value - mean) for value in column) / len(column))


def _quantile(column: list[float], part: float) -> float:
    place = part * (len(column) - 1)
    low = int(place)
    high = min(low + 1, len(column) - 1)
    return column[low] + (column[high] - column[low]) * (place - low)
