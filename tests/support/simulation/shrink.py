"""Shrinking: the fewest faults of a schedule that still break the same promise, by delta debugging."""

from collections.abc import Callable, Sequence
from typing import TypeVar

_Item = TypeVar("_Item")


def shrunk(items: Sequence[_Item], fails: Callable[[Sequence[_Item]], bool], *, tries: int = 2_000) -> list[_Item]:
    """Return a part of the items, in their order, of which none can be left out: with each of them it still fails.

    Parameters
    ----------
    fails : callable
        Whether a part of the items fails as all of them do.
    tries : int
        How often that may be asked; then the smallest part found so far is returned.

    References
    ----------
    A. Zeller, R. Hildebrandt: Simplifying and isolating failure-inducing input (2002), DOI 10.1109/32.988498:
    the algorithm `ddmin`, of which subsets are left out here, as complements alone shrink a schedule.
    """
    left, pieces = list(items), 2
    while left and tries > 0:
        size = -(-len(left) // min(pieces, len(left)))
        for start in range(0, len(left), size):
            rest = left[:start] + left[start + size :]
            tries -= 1
            if fails(rest):
                left, pieces = rest, max(pieces - 1, 2)
                break
            if tries <= 0:
                break
        else:
            if size == 1:
                break
            pieces = min(2 * pieces, len(left))
    return left
