"""Checks of what a learner is given: rows of inputs and targets, and the constants that centre them."""

import numpy as np
from numpy.typing import ArrayLike

from pipeline.arrays import Floats
from recorders.errors import ConfigError, MessageError


def rows_of(name: str, values: ArrayLike, width: int) -> Floats:
    """Return rows as float64, shape (n, width), one number beside the next.

    Raises
    ------
    MessageError
        If the shape is another.
    """
    rows = np.asarray(values, dtype=np.float64, order="C")
    if rows.ndim != 2 or rows.shape[1] != width:
        raise MessageError(f"expected {name} of shape (n, {width}), found {rows.shape}")
    return rows


def finite_rows(name: str, values: ArrayLike, width: int) -> Floats:
    """Return rows as `rows_of` does, with finite numbers alone.

    Raises
    ------
    MessageError
        If the shape is another, or a number is NaN or infinity.
    """
    rows = rows_of(name, values, width)
    if not np.isfinite(rows).all():
        raise not_finite(name)
    return rows


def pairs_of(u: Floats, d: Floats) -> None:
    """Check that there are as many targets d as inputs u.

    Raises
    ------
    MessageError
        If there are not.
    """
    if len(u) != len(d):
        raise MessageError(f"expected as many rows of d as of u, found {len(d)} and {len(u)}")


def centre_of(name: str, values: ArrayLike, size: int) -> Floats:
    """Return a constant of a learner as an array that cannot be written to.

    Raises
    ------
    ConfigError
        If its shape is not (size,), or a number is NaN or infinity.
    """
    centre = np.array(values, dtype=np.float64)
    if centre.shape != (size,) or not np.isfinite(centre).all():
        raise ConfigError(f"expected {name} to be {size} finite numbers, found {values!r}")
    centre.flags.writeable = False
    return centre


def not_finite(name: str) -> MessageError:
    """Return the error of rows with NaN or infinity in them."""
    return MessageError(f"expected finite numbers in {name}, found NaN or infinity")
