"""Motions: what both hands are asked to do, from the two patterns of the paper or from a CSV file."""

import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pipeline.arrays import Floats
from pipeline.motions.csv_file import MAX_COORDINATE_M, MAX_TIME_S, read_table
from pipeline.motions.names import PATTERNS, drawings, motion_names
from pipeline.robot.config import RobotConfig
from pipeline.robot.range_check import range_check
from recorders.errors import MessageError, MotionError
from recorders.files.regular_file import require_regular_file
from recorders.reading.parts import is_log
from recorders.text.wording import names_text

CSV_COLUMNS = ("t", "lx", "ly", "lz", "rx", "ry", "rz")
RADIUS_M = 0.10
PATTERN_PERIOD_S = 0.2  # the paper's 5 Hz


@dataclass(frozen=True, eq=False)
class Motion:
    """Target positions of both hands over time.

    Attributes
    ----------
    name : str
    times_s : ndarray
        Strictly increasing times of the samples [s], shape (T,), T >= 2.
    left, right : ndarray
        Hand targets [m], world frame, shape (T, 3).
    closed : bool
        Whether the first sample follows the last, so that the motion can go round and round.

    Raises
    ------
    MotionError
        Shapes do not fit, values are not finite or beyond `MAX_TIME_S` or `MAX_COORDINATE_M`, or times do not increase.
    """

    name: str
    times_s: Floats
    left: Floats
    right: Floats
    closed: bool

    def __post_init__(self) -> None:
        for field in ("times_s", "left", "right"):
            array = np.array(getattr(self, field), dtype=np.float64)
            array.setflags(write=False)
            object.__setattr__(self, field, array)
        samples = self.times_s.size
        if samples < 2:
            raise MotionError(f"motion '{self.name}': expected at least two samples, found {samples}")
        if self.times_s.ndim != 1 or self.left.shape != (samples, 3) or self.right.shape != (samples, 3):
            shapes = f"{self.times_s.shape}, {self.left.shape}, {self.right.shape}"
            raise MotionError(f"motion '{self.name}': expected shapes (T,), (T, 3), (T, 3), found {shapes}")
        if not all(np.isfinite(array).all() for array in (self.times_s, self.left, self.right)):
            raise MotionError(f"motion '{self.name}': expected finite numbers, found NaN or infinity")
        if np.abs(self.times_s).max() > MAX_TIME_S or np.abs([self.left, self.right]).max() > MAX_COORDINATE_M:
            raise MotionError(
                f"motion '{self.name}': expected times within {MAX_TIME_S:g} s and positions within "
                f"{MAX_COORDINATE_M:g} m"
            )
        if not (np.diff(self.times_s) > 0.0).all():
            raise MotionError(f"motion '{self.name}': expected increasing times")

    def __len__(self) -> int:
        return int(self.times_s.size)

    @property
    def targets(self) -> Floats:
        """Targets of both hands [m], left then right, shape (T, 2, 3)."""
        return np.stack([self.left, self.right], axis=1)

    @property
    def sha256(self) -> str:
        """SHA-256 of the samples and of whether they close; the name does not enter."""
        content = np.column_stack([self.times_s, self.left, self.right]).astype("<f8").tobytes()
        return hashlib.sha256(bytes([self.closed]) + content).hexdigest()


def circles(robot: RobotConfig) -> Motion:
    """Pattern 1 (T = 256): circles of both hands that combine all their positions evenly.

    In the first half the left hand turns 6 times one way and the right hand 7 times the other; in the second half
    they exchange speeds and directions. The sum of both angles thus drifts through one slow turn in each half, and each
    of the 16 combinations of quadrants (left hand top/down and left/right, right hand the same) gets 16 samples.
    """
    left = _angles((6, -7), samples=256, start=0.3)
    right = _angles((-7, 6), samples=256, start=1.1)
    return _pattern("circles", robot, (np.cos(left), np.sin(left)), (np.cos(right), np.sin(right)))


def eight(robot: RobotConfig) -> Motion:
    """Pattern 2 (T = 64): twice a lying eight with the left hand, twice a circle with the right.

    The left/right coordinate of both hands is exactly the same: they never both point to the middle or both outwards.
    """
    angle = _angles((2,), samples=64, start=0.0)
    return _pattern("eight", robot, (np.sin(angle), np.sin(2.0 * angle)), (np.sin(angle), np.cos(angle)))


def load_motion(name_or_path: str | Path, robot: RobotConfig) -> Motion:
    """Load a pattern by name, a drawing that comes with the program by name, or a CSV file by path.

    Raises
    ------
    MotionError
        The motion is unknown, or its file is malformed or holds what cannot be a target of the robot.
    """
    patterns = dict(zip(PATTERNS, (circles, eight), strict=True))
    if str(name_or_path) in patterns:
        return patterns[str(name_or_path)](robot)
    path = drawings().get(str(name_or_path), Path(name_or_path))
    require_regular_file(path, expected="a CSV file", error=MotionError)
    if not path.is_file():
        known = names_text(motion_names())
        raise MotionError(f"unknown motion '{name_or_path}': expected one of {known}, or a CSV file")
    motion = read_motion_csv(path)
    check_targets(motion, robot)
    return motion


def check_targets(motion: Motion, robot: RobotConfig) -> None:
    """Check that a motion's targets can be the robot's; raises MotionError, naming sample and hand."""
    check = range_check(robot)
    for sample, hands in enumerate(motion.targets.tolist()):
        for hand, target in zip(("left", "right"), hands, strict=True):
            try:
                check.check_target(target)
            except MessageError as error:
                raise MotionError(f"motion '{motion.name}', sample {sample}, {hand} hand: {error}") from None


def is_recorded(name_or_path: str | Path) -> bool:
    """Return whether a motion is given as a recording: a log or the parts of a session, and no name of a motion."""
    return str(name_or_path) not in motion_names() and is_log(Path(name_or_path))


def read_motion_csv(path: str | Path) -> Motion:
    """Read an open motion from a CSV file with the columns t, lx, ly, lz, rx, ry, rz [s, m, world frame].

    Columns are found by name and others are left alone; empty lines and lines that start with # are skipped.

    Raises
    ------
    MotionError
        The file cannot be read, lacks a column, holds something else than finite numbers of a plausible size, has fewer
        than two rows, or its times do not increase; the message names line and column.
    """
    path = Path(path)
    table = read_table(path, choose=_all_columns)
    return Motion(path.stem, table[:, 0], table[:, 1:4], table[:, 4:7], closed=False)


def _all_columns(header: Sequence[str]) -> Sequence[str]:
    if missing := [column for column in CSV_COLUMNS if column not in header]:
        raise MotionError(f"the header lacks {', '.join(missing)}: expected the columns {','.join(CSV_COLUMNS)}")
    return CSV_COLUMNS


def _angles(turns: Sequence[int], *, samples: int, start: float) -> Floats:
    """Angles [rad] that make each number of `turns` in an equal part of the samples, shape (samples,)."""
    part = samples // len(turns)
    steps = np.repeat(2.0 * math.pi * np.array(turns, dtype=np.float64) / part, part)
    return start + np.concatenate([[0.0], np.cumsum(steps)[:-1]])


def _pattern(name: str, robot: RobotConfig, left: tuple[Floats, Floats], right: tuple[Floats, Floats]) -> Motion:
    """Make a closed motion from each hand's (lateral, up) coordinates in radii, in the robot's plane."""
    plane = np.stack([robot.lateral, robot.up])  # (2, 3)
    offsets = [RADIUS_M * np.stack(hand, axis=1) @ plane for hand in (left, right)]
    # To the nanometre: the same targets, to the bit, whichever library computed the sines.
    centres = robot.centres
    hands = [np.round(centre + offset, 9) for centre, offset in zip(centres, offsets, strict=True)]
    times_s = np.round(PATTERN_PERIOD_S * np.arange(len(hands[0])), 9)
    return Motion(name, times_s, hands[0], hands[1], closed=True)
