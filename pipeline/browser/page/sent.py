"""Numbers as a visitor's browser sends them, which may be anything."""

import numpy as np

from pipeline.arrays import Floats


def vector(sent: object, size: int) -> Floats | None:
    """Return finite numbers of shape (size,), None where what was sent is something else."""
    try:
        found = np.asarray(sent, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        return None
    return found if found.shape == (size,) and np.isfinite(found).all() else None
