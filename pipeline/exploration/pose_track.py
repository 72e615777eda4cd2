"""The path of a hand, gathered pose by pose; what is of no use is left out and counted."""

import hashlib
from collections import Counter
from dataclasses import dataclass

import numpy as np

from pipeline.arrays import Floats
from pipeline.motions.csv_file import MAX_GAP_S
from recorders.cdr.codec import decode_as
from recorders.errors import MessageError, MotionError
from recorders.messages.message_types import PoseStamped
from recorders.messages.record import RecordedMessage

MAX_COORDINATE = 1e6
"""Largest coordinate taken, in whatever unit: a scale brings it to metres."""

MAX_POSES = 1_000_000
"""Most poses of a hand: a quarter of an hour at 1 kHz."""


@dataclass(frozen=True, eq=False)
class HandPath:
    """Path of one hand.

    Attributes
    ----------
    times_s : ndarray
        Strictly increasing times [s], shape (N,); those of all hands count from the same instant.
    points : ndarray
        Positions, in whatever unit and axes the source has, shape (N, 3).
    quaternions : ndarray or None
        Orientations x, y, z, w in these axes, shape (N, 4), of which some may be none; None if none is shown.
    """

    times_s: Floats
    points: Floats
    quaternions: Floats | None = None


class PoseTrack:
    """Poses of one hand in the order of their stamps; what is of no use is left out and counted.

    Parameters
    ----------
    max_gap_s : float, optional
        A pose stamped farther ahead of the last than this is left out [s]: a live tracker's clock may leap. Without it,
        one farther ahead than `motions.csv_file.MAX_GAP_S` is an error: the times of the whole file are in doubt.

    Attributes
    ----------
    seen : int
        Messages taken in, of use or not.
    left_out : counter of str
        Poses left out, by reason.
    """

    def __init__(self, *, max_gap_s: float | None = None) -> None:
        self._max_gap_s = max_gap_s
        self._poses: list[PoseStamped] = []
        self.seen = 0
        self.left_out: Counter[str] = Counter()

    def __len__(self) -> int:
        return len(self._poses)

    @property
    def span_s(self) -> float:
        """Time from the first pose to the last [s]."""
        return (self._poses[-1].stamp_ns - self._poses[0].stamp_ns) / 1e9 if self._poses else 0.0

    @property
    def first_ns(self) -> int:
        """Stamp of the first pose [ns]; there must be one."""
        return self._poses[0].stamp_ns

    def take(self, record: RecordedMessage) -> bool:
        """Take in a message; returns whether it is of use.

        Raises
        ------
        MessageError
            If it is no PoseStamped, or is stamped too far ahead where that is an error.
        MotionError
            If there are too many.
        """
        self.seen += 1
        if record.type not in ("", PoseStamped.TYPE):
            raise MessageError(f"{record.topic}: expected {PoseStamped.TYPE}, found {record.type[:80]!r}")
        pose = decode_as(PoseStamped, record.data)
        if reason := self._objection(pose):
            self.left_out[reason] += 1
            return False
        if len(self) >= MAX_POSES:
            raise MotionError(f"{record.topic}: expected at most {MAX_POSES} poses, found more")
        if self._max_gap_s is None:
            self._check_gap(record.topic, pose)
        self._poses.append(pose)
        return True

    def path(self, *, from_ns: int) -> HandPath:
        """Return the path, timed from a stamp on."""
        times_s = np.array([pose.stamp_ns - from_ns for pose in self._poses]) / 1e9
        points, turns = ([getattr(pose, part) for pose in self._poses] for part in ("position", "orientation"))
        return HandPath(times_s, np.array(points), np.array(turns))

    def digest_into(self, digest: "hashlib._Hash") -> None:
        """Add stamps and positions to a digest."""
        digest.update(np.array([pose.stamp_ns for pose in self._poses], dtype="<i8").tobytes())
        digest.update(np.array([pose.position for pose in self._poses], dtype="<f8").tobytes())

    def _check_gap(self, topic: str, pose: PoseStamped) -> None:
        gap_s = self._ahead_s(pose)
        if gap_s > MAX_GAP_S:
            raise MessageError(
                f"{topic}, pose {self.seen}: expected a stamp at most {MAX_GAP_S:g} s after the last, found {gap_s:g}; "
                "are the stamps in seconds and nanoseconds?"
            )

    def _ahead_s(self, pose: PoseStamped) -> float:
        """Return the time between the last pose and this one [s]; 0 for the first."""
        return (pose.stamp_ns - self._poses[-1].stamp_ns) / 1e9 if self._poses else 0.0

    def _objection(self, pose: PoseStamped) -> str:
        """Why a pose is of no use; the empty string if it is."""
        if not all(abs(value) <= MAX_COORDINATE for value in pose.position.tolist()):  # nor is NaN
            return "not a position"
        if self._poses and pose.stamp_ns <= self._poses[-1].stamp_ns:
            return "stamp not after the last"
        if self._max_gap_s is not None and self._ahead_s(pose) > self._max_gap_s:
            return "stamp far ahead"
        return ""
