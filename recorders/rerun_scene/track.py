"""A stretch of a robot's motion, checked, as the Rerun recorder draws it."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np
import rerun as rr
from numpy.typing import ArrayLike, NDArray

from recorders.errors import JointError, MotionError
from recorders.messages.validation import FloatArray
from recorders.text.wording import hand_text

Times = NDArray[np.int64]

TIMELINE = "time"

MAX_TIME_NS = 2**63 - 1
"""The latest time, and with the other sign the earliest, that a timeline of Rerun's holds [ns]."""

MAX_NUMBER = 1e9
"""No joint [rad or m] and no hand [m] is shown farther from 0; single precision separates nothing out there."""

_CM_PER_M = 100.0


@dataclass(frozen=True, eq=False)
class Track:
    """The paths that are drawn, one row per sample.

    Attributes
    ----------
    times_ns : Times
        From the start of the motion [ns], shape (T,).
    joints : ndarray
        Postures [rad or m], shape (T, n).
    targets, reached : ndarray
        Hand positions [m], shape (T, hands, 3).
    scored : ndarray of bool or None
        Rows whose error is plotted, shape (T,); all if left out.
    orientations : mapping of str to (ndarray, ndarray)
        Quaternions x, y, z, w of the target and as reached, shape (T, 4) each, by hand whose pose is controlled.
    """

    times_ns: Times
    joints: FloatArray
    targets: FloatArray
    reached: FloatArray
    scored: NDArray[np.bool_] | None = None
    orientations: Mapping[str, tuple[FloatArray, FloatArray]] = field(default_factory=dict)

    @classmethod
    def checked(
        cls,
        *,
        joint_count: int,
        hand_count: int,
        times_ns: ArrayLike,
        joints: ArrayLike,
        targets: ArrayLike,
        reached: ArrayLike,
        orientations: Mapping[str, tuple[FloatArray, FloatArray]] = MappingProxyType({}),
    ) -> "Track":
        """Copy the arrays; times are whole numbers [ns].

        Raises
        ------
        JointError
            `joints` has another shape than `joint_count` and the times ask for.
        MotionError
            Times or positions are of the wrong shape, or a number is not finite or beyond
            `MAX_NUMBER`, or a time is no whole number or beyond
            `MAX_TIME_NS`.
        """
        arrays = [np.array(array, dtype=np.float64) for array in (joints, targets, reached)]
        track = cls(_whole_ns(times_ns), arrays[0], arrays[1], arrays[2], orientations=orientations)
        samples = len(track.times_ns) if track.times_ns.ndim == 1 else 0
        if samples == 0:
            raise MotionError(f"expected times of shape (T,) with T >= 1, found {track.times_ns.shape}")
        if track.joints.shape != (samples, joint_count):
            raise JointError(f"expected joints of shape {(samples, joint_count)}, found {track.joints.shape}")
        for name in ("targets", "reached"):
            if (found := getattr(track, name).shape) != (samples, hand_count, 3):
                raise MotionError(f"expected {name} of shape {(samples, hand_count, 3)}, found {found}")
        for name in ("joints", "targets", "reached"):
            if not (np.abs(getattr(track, name)) <= MAX_NUMBER).all():  # nor is NaN
                raise MotionError(f"expected finite numbers within {MAX_NUMBER:g} of zero in {name}, found others")
        for hand, quaternions in orientations.items():
            if not all(turned.shape == (samples, 4) and np.isfinite(turned).all() for turned in quaternions):
                raise MotionError(
                    f"expected finite orientations of {hand_text(hand)}, of shape {(samples, 4)}, found others"
                )
        return track

    @property
    def instants(self) -> "Instants":
        """Times of the rows on the timeline of time."""
        return Instants(TIMELINE, self.times_ns)

    @property
    def errors_cm(self) -> FloatArray:
        """Distance of each hand from its target [cm], shape (T, hands)."""
        return np.asarray(np.linalg.norm(self.reached - self.targets, axis=2) * _CM_PER_M)

    @property
    def plotted(self) -> NDArray[np.bool_]:
        """Rows whose error is plotted, shape (T,): those scored, if there are any, else all."""
        if self.scored is None or not self.scored.any():
            return np.ones(len(self.times_ns), dtype=np.bool_)
        return self.scored

    def recording_id(self, *parts: str) -> str:
        """Return an identity derived from the content, for the viewer merges recordings of one identity."""
        digest = hashlib.sha256(json.dumps(parts).encode())
        digest.update(self.times_ns.astype("<i8").tobytes())
        turned = [quaternions for pair in self.orientations.values() for quaternions in pair]
        for array in (self.joints, self.targets, self.reached, *turned):
            digest.update(np.ascontiguousarray(array, dtype="<f8").tobytes())
        return digest.hexdigest()[:32]


@dataclass(frozen=True, eq=False)
class Instants:
    """Times of rows on a timeline.

    Attributes
    ----------
    timeline : str
    values : ndarray, shape (T,)
        Times [ns] on the timeline `TIMELINE`, else whole numbers such as epochs.
    """

    timeline: str
    values: Times

    def columns(self, *, each: int = 1) -> list[rr.TimeColumn]:
        """Return the index for `each` rows at every instant."""
        values = np.repeat(self.values, each)
        if self.timeline == TIMELINE:
            return [rr.TimeColumn(self.timeline, duration=values.astype("timedelta64[ns]"))]
        return [rr.TimeColumn(self.timeline, sequence=values)]


def _whole_ns(times_ns: ArrayLike) -> Times:
    """Return times as int64, none of them the one that Rerun takes for no time at all."""
    times = np.array(times_ns, dtype=object)
    if not all(isinstance(time, int | np.integer) and abs(int(time)) <= MAX_TIME_NS for time in times.flat):
        raise MotionError(f"expected times in whole nanoseconds, {MAX_TIME_NS} at most, found others")
    return times.astype(np.int64)
