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
    """

    times_s: Floats
    joints: Floats
    targets: Floats
    reached: Floats

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
        track = cls(*(np.array(array, dtype=np.float64) for array in (times_s, joints, targets, reached)))
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
    def index(self) -> rr.TimeColumn:
        """The times as Rerun wants them."""
        return time_column(self.times_s)

    @property
    def errors_cm(self) -> Floats:
        """Distance of each hand from its target [cm], shape (T, 2)."""
        return np.asarray(np.linalg.norm(self.reached - self.targets, axis=2) * _CM_PER_M)

    def recording_id(self, *parts: str) -> str:
        """Return an identity made of the content, for the viewer merges recordings of one identity."""
        digest = hashlib.sha256(json.dumps(parts).encode())
        for array in (self.times_s, self.joints, self.targets, self.reached):
            digest.update(np.ascontiguousarray(array, dtype="<f8").tobytes())
        return digest.hexdigest()[:32]


def time_column(times_s: Floats) -> rr.TimeColumn:
    """Return times [s], shape (T,), for Rerun; rounded here, for given seconds it cuts 0.3 s to 299 999 999 ns."""
    return rr.TimeColumn(TIMELINE, duration=np.rint(times_s * _NS_PER_S).astype("timedelta64[ns]"))
