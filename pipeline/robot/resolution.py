"""Resolution of a simulated robot: what its sensors measure and its motors take lies on grids of powers of two."""

import math
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike

from pipeline.arrays import Floats
from pipeline.robot.toml_values import as_number, as_table
from recorders.errors import RobotError
from recorders.text.wording import value_text

FINEST, COARSEST = 2.0**-40, 1.0
"""A finer grid would be no protection from the last bits of a computation, a coarser one no robot's."""


@dataclass(frozen=True)
class Resolution:
    """Steps of the grids, all powers of two; 0 where values stay as they are computed.

    The last bits of a simulation depend on the machine. Values on a grid do not, unless one lies within those bits of
    the middle between two points of it.

    Attributes
    ----------
    positions, velocities : float
        Of measured joints [rad or m; rad/s or m/s].
    hands : float
        Of measured hands [m].
    commands : float
        Of the positions that motors take [rad or m].
    tf : float
        Of the poses of links [m, and parts of a unit quaternion].
    """

    positions: float = 0.0
    velocities: float = 0.0
    hands: float = 0.0
    commands: float = 0.0
    tf: float = 0.0


UNLIMITED = Resolution()
"""Resolution of a robot that states none."""


def on_grid(values: ArrayLike, step: float) -> Floats:
    """Return values rounded to multiples of a power of two, which is exact; as they are if the step is 0.

    Examples
    --------
    >>> on_grid([0.3, -0.1, 1.0], 0.25).tolist()
    [0.25, 0.0, 1.0]
    """
    computed = np.asarray(values, dtype=np.float64)
    if not step:
        return computed
    with np.errstate(over="ignore"):
        rounded = np.rint(computed / step) * step + 0.0  # + 0.0: no -0.0, whose sign is noise
    return np.where(np.isfinite(rounded), rounded, computed)  # what is too large to be divided is on the grid


def parse_resolution(value: object) -> Resolution:
    """Return the resolution of the `[resolution]` of a robot's config.

    Raises
    ------
    RobotError
        A key is missing or unknown, or a step is not a power of two from `FINEST` to `COARSEST`.
    """
    names = [field.name for field in fields(Resolution)]
    table = as_table(value, frozenset(names), "[resolution]")
    return Resolution(**{name: _step(table[name], f"[resolution] {name}") for name in names})


def _step(value: object, where: str) -> float:
    step = as_number(value, where)
    if not FINEST <= step <= COARSEST or math.frexp(step)[0] != 0.5:
        expected = f"expected a power of two from {FINEST!r} to {COARSEST!r}, such as {2.0**-20!r}"
        raise RobotError(f"{where} of the robot config: {expected}, found {value_text(value)}")
    return step
