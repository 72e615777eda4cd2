"""A stretch of a robot's motion, checked, as the Rerun recorder draws it."""

import hashlib
import json
from dataclasses import dataclass

import numpy as np
import rerun as rr
from numpy.typing import ArrayLike, NDArray

from recorders.errors import JointError, MotionError

Floats = NDArray[np.float64]

TIMELINE = "time"

_CM_PER_M = 100.0
_NS_PER_S = 1e9


@dataclass(frozen=True, eq=False)
class Track:
    """What is drawn, one row per sample.

    Attributes
    ----------
    times_s : shape (T,)
    joints : postures [rad or m], shape (T, n)
    targets, reached : hand positions [m], left then right, shape (T, 2, 3)
    scored : rows whose error is plotted, shape (T,); all if left out
    """

    times_s: Floats
    joints: Floats
    targets: Floats
    reached: Floats
    scored: NDArray[np.bool_] | None = None

    @classmethod
    def checked(
        cls, *, joint_count: int, times_s: ArrayLike, joints: ArrayLike, targets: ArrayLike, reached: ArrayLike
    ) -> "Track":
        """Copy the arrays.

        Raises
        ------
        JointError
            `joints` has another shape than `joint_count` and the times ask for.
        MotionError
            Times or positions are of the wrong shape, or a number is not finite.
        """
        arrays = [np.array(array, dtype=np.float64) for array in (times_s, joints, targets, reached)]
        track = cls(arrays[0], arrays[1], arrays[2], arrays[3])
        samples = len(track.times_s) if track.times_s.ndim == 1 else 0
        if samples == 0:
            raise MotionError(f"expected times of shape (T,) with T >= 1, found {track.times_s.shape}")
        if track.joints.shape != (samples, joint_count):
            raise JointError(f"expected joints of shape {(samples, joint_count)}, found {track.joints.shape}")
        for name in ("targets", "reached"):
            if getattr(track, name).shape != (samples, 2, 3):
                raise MotionError(f"expected {name} of shape {(samples, 2, 3)}, found {getattr(track, name).shape}")
        for name in ("times_s", "joints", "targets", "reached"):
            if not np.isfinite(getattr(track, name)).all():
                raise MotionError(f"expected finite numbers in {name}, found NaN or infinity")
        return track

    @property
    def instants(self) -> "Instants":
        """Where the rows stand on the timeline of time."""
        return Instants(TIMELINE, self.times_s)

    @property
    def errors_cm(self) -> Floats:
        """Distance of each hand from its target [cm], shape (T, 2)."""
        return np.asarray(np.linalg.norm(self.reached - self.targets, axis=2) * _CM_PER_M)

    @property
    def plotted(self) -> NDArray[np.bool_]:
        """Rows whose error is plotted, shape (T,): those scored, if there are any, else all."""
        if self.scored is None or not self.scored.any():
            return np.ones(len(self.times_s), dtype=np.bool_)
        return self.scored

    def recording_id(self, *parts: str) -> str:
        """Return an identity made of the content, for the viewer merges recordings of one identity."""
        digest = hashlib.sha256(json.dumps(parts).encode())
        for array in (self.times_s, self.joints, self.targets, self.reached):
            digest.update(np.ascontiguousarray(array, dtype="<f8").tobytes())
        return digest.hexdigest()[:32]


@dataclass(frozen=True, eq=False)
class Instants:
    """Where rows stand on a timeline.

    Attributes
    ----------
    timeline : str
    values : ndarray, shape (T,)
        Times [s] as float64, or whole numbers, such as epochs, as int64.
    """

    timeline: str
    values: NDArray[np.float64] | NDArray[np.int64]

    def columns(self, *, each: int = 1) -> list[rr.TimeColumn]:
        """Return the index for `each` rows at every instant; rounded here, for Rerun cuts 0.3 s to 299 999 999 ns."""
        values = np.repeat(self.values, each)
        if values.dtype == np.int64:
            return [rr.TimeColumn(self.timeline, sequence=values)]
        return [rr.TimeColumn(self.timeline, duration=np.rint(values * _NS_PER_S).astype("timedelta64[ns]"))]
