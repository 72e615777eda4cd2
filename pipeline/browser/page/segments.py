"""Paths as the segments that viser draws."""

import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Floats


def segments(points: Floats) -> NDArray[np.float32]:
    """Return the segments between points [m], shape (T, 3): shape (T - 1, 2, 3), none of fewer than two."""
    if len(points) < 2:
        return np.zeros((0, 2, 3), dtype=np.float32)
    return np.stack([points[:-1], points[1:]], axis=1).astype(np.float32)


NOTHING = segments(np.zeros((0, 3)))
"""No segments."""
