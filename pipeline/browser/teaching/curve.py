"""Curve of the error of a learner over what it has learned from."""

import math
import threading
from collections.abc import Sequence

import numpy as np

from pipeline.arrays import Floats

_MOST = 4096  # points; beyond this every other is left out


class Curve:
    """Errors of the hands by how far a learner has come; they come on one thread and are read on others.

    Parameters
    ----------
    hands : int
        How many hands.
    unit : str
        Unit of how far it has come, such as passes or s.
    """

    def __init__(self, hands: int, unit: str) -> None:
        self.unit = unit
        self._hands = hands
        self._lock = threading.Lock()
        self._points: list[tuple[float, ...]] = []

    def add(self, at: float, hands_cm: Sequence[float]) -> None:
        """Add the errors [cm] of all hands; what does not come later than the last, or is no number, is left out."""
        point = (at, *hands_cm)
        if len(hands_cm) != self._hands or not all(map(math.isfinite, point)):
            return
        with self._lock:
            if self._points and at <= self._points[-1][0]:
                return
            if len(self._points) >= _MOST:
                del self._points[1::2]
            self._points.append(point)

    @property
    def last_cm(self) -> float | None:
        """Mean of the last errors of all hands [cm]; None before there are any."""
        with self._lock:
            return sum(self._points[-1][1:]) / self._hands if self._points else None

    @property
    def last_at(self) -> float | None:
        """How far the learner has come by its last errors; None before there are any."""
        with self._lock:
            return self._points[-1][0] if self._points else None

    def points(self, most: int) -> Floats:
        """Return at most about so many points, the last among them, shape (points, 1 + hands)."""
        with self._lock:
            found = np.array(self._points).reshape(-1, 1 + self._hands)
        return found[::-1][:: max(1, len(found) // most)][::-1]
