"""A learner's state as named arrays: its digest, and whether arrays are such a state."""

import hashlib
import math
from collections.abc import Mapping

import numpy as np

from pipeline.arrays import Floats
from recorders.errors import ControllerError
from recorders.text.wording import names_text

Shapes = Mapping[str, tuple[int, ...]]

MAX_NUMBERS = 2**20
"""Numbers in a state that goes into a file; a thousand neurons, each connected to each, take fewer."""


def state_digest(state: Mapping[str, Floats], pending: Floats | None = None) -> str:
    """SHA-256 of a learner's state and of the u that waits for its target.

    Parameters
    ----------
    state : mapping of str to ndarray
        The state in its fixed order; names and shapes enter the digest, values as little-endian float64.
    pending : ndarray, shape (inputs,), optional
        The u of the tick that has no successor yet, in metres as received.

    Returns
    -------
    str
        64 hexadecimal digits.
    """
    digest = hashlib.sha256()
    for name, values in {**state, "pending": np.empty(0) if pending is None else pending}.items():
        digest.update(f"{name} {'x'.join(map(str, values.shape))}\n".encode())
        digest.update(np.ascontiguousarray(values, dtype="<f8").tobytes())
    return digest.hexdigest()


def state_numbers(shapes: Shapes) -> int:
    """Return how many numbers a state of these shapes has."""
    return sum(math.prod(shape) for shape in shapes.values())


def check_state(shapes: Shapes, state: Mapping[str, Floats]) -> None:
    """Check names, shapes and values of a state.

    Raises
    ------
    ControllerError
        If an array is missing, unknown, of the wrong shape, or not finite.
    """
    if set(state) != set(shapes):
        raise ControllerError(f"expected state {names_text(shapes)}; found {names_text(map(str, state))}")
    for name, shape in shapes.items():
        if np.shape(state[name]) != shape:
            raise ControllerError(f"expected state {name} of shape {shape}, found {np.shape(state[name])}")
        if not np.isfinite(state[name]).all():
            raise ControllerError(f"expected finite numbers in state {name}, found NaN or infinity")
