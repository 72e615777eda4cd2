"""A bound with what was found, and the spread of what is measured more than once."""

from typing import NamedTuple

from pipeline.arrays import Floats


class BoundCheck(NamedTuple):
    """A bound, what was found, and whether it holds."""

    claim: str
    found: str
    holds: bool


def spread(values: Floats) -> float:
    """Return the standard deviation of a sample, 0 for a single value."""
    return float(values.std(ddof=1)) if values.size > 1 else 0.0


def at_most(claim: str, found_cm: float, bound_cm: float, *, digits: int = 2) -> BoundCheck:
    """Return the check that an error [cm] is at most a bound [cm], both written with so many digits."""
    return BoundCheck(f"{claim}: at most {bound_cm:.2f} cm", f"{found_cm:.{digits}f} cm", found_cm <= bound_cm)
