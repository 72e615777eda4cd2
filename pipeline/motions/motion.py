"""Motions: what the hands are asked to do, from the two patterns of the paper or from a CSV file."""

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType

import numpy as np

from pipeline.arrays import Floats
from pipeline.motions import patterns
from pipeline.motions.csv_file import MAX_COORDINATE_M, MAX_TIME_S, read_table
from pipeline.motions.names import drawings
from pipeline.robot.config import RobotConfig
from pipeline.robot.coordinates import POSITION_SIZE, ROW_SIZE, row_size, with_orientations
from pipeline.robot.hands import Quaternion
from pipeline.robot.range_check import range_check
from recorders.errors import MessageError, MotionError
from recorders.files.regular_file import require_regular_file
from recorders.reading.parts import is_log
from recorders.registry import Registry
from recorders.text.wording import did_you_mean, hand_label, names_text

_SHORT = {"left": "l", "right": "r"}
_IDENTITY: Quaternion = (0.0, 0.0, 0.0, 1.0)
_NO_MIDDLES: Mapping[str, Quaternion] = MappingProxyType({})


@dataclass(frozen=True, eq=False)
class Motion:
    """Targets of the hands over time: positions, and orientations where the pose of a hand is controlled.

    Attributes
    ----------
    name : str
    times_s : ndarray
        Strictly increasing times of the samples [s], shape (T,), T >= 2.
    targets : ndarray
        Targets of the hands, in the robot's order, world frame, shape (T, hands, 3) [m]; or (T, hands, 7), each
        with its orientation as a quaternion x, y, z, w.
    closed : bool
        Whether the first sample follows the last, so that the motion can go round and round.

    Raises
    ------
    MotionError
        Shapes do not fit, values are not finite or beyond `MAX_TIME_S` or `MAX_COORDINATE_M`, or times do not increase.
    """

    name: str
    times_s: Floats
    targets: Floats
    closed: bool

    def __post_init__(self) -> None:
        for field in ("times_s", "targets"):
            array = np.array(getattr(self, field), dtype=np.float64)
            array.setflags(write=False)
            object.__setattr__(self, field, array)
        samples = self.times_s.size
        if samples < 2:
            raise MotionError(f"motion '{self.name}': expected at least two samples, found {samples}")
        hands = self.targets.shape[1] if self.targets.ndim == 3 else 0
        fits = self.times_s.ndim == 1 and self.targets.shape[:-1] == (samples, hands)
        if not fits or hands < 1 or self.targets.shape[-1] not in (POSITION_SIZE, ROW_SIZE):
            shapes = f"{self.times_s.shape}, {self.targets.shape}"
            raise MotionError(f"motion '{self.name}': expected shapes (T,), (T, hands, 3 or 7), found {shapes}")
        if not (np.isfinite(self.times_s).all() and np.isfinite(self.targets).all()):
            raise MotionError(f"motion '{self.name}': expected finite numbers, found NaN or infinity")
        if np.abs(self.times_s).max() > MAX_TIME_S or np.abs(self.targets).max() > MAX_COORDINATE_M:
            raise MotionError(
                f"motion '{self.name}': expected times within {MAX_TIME_S:g} s and positions within "
                f"{MAX_COORDINATE_M:g} m"
            )
        if not (np.diff(self.times_s) > 0.0).all():
            raise MotionError(f"motion '{self.name}': expected increasing times")

    def __len__(self) -> int:
        return int(self.times_s.size)

    @property
    def sha256(self) -> str:
        """SHA-256 of the samples and of whether they close; the name does not enter."""
        content = np.column_stack([self.times_s, self.targets.reshape(len(self), -1)]).astype("<f8").tobytes()
        return hashlib.sha256(bytes([self.closed]) + content).hexdigest()


@dataclass(frozen=True)
class NamedMotion:
    """Motion that is generated for a robot, and known by a name wherever one is asked for.

    A motion is a module with `MOTION`: here in `pipeline.motions.patterns`, named as the motion is, or in a
    distribution of others, under an entry point of the group `reenact.motions`. `pipeline.motions.contract` has tests
    for it.

    Parameters
    ----------
    name : str
        Its name.
    make : callable
        Makes the motion of a robot.
    """

    name: str
    make: Callable[[RobotConfig], Motion]


MOTIONS = Registry("motion", NamedMotion, room=patterns, constant="MOTION", group="reenact.motions")


def load_motion(
    name_or_path: str | Path, robot: RobotConfig, *, or_file: str = "a CSV file", others: Sequence[str] = ()
) -> Motion:
    """Load a motion by name, a drawing that comes with the program by name, or a CSV file by path.

    Parameters
    ----------
    name_or_path : str or Path
        What it is called, or where it is.
    robot : RobotConfig
        Whose hands do it.
    or_file : str
        What may be named in its place, for the error line.
    others : sequence of str
        Names that are taken besides, for the error line.

    Raises
    ------
    ConfigError
        What is installed under this name is no motion.
    MotionError
        The motion is unknown, or its file is malformed or holds what cannot be a target of the robot.
    """
    if (named := MOTIONS.get(str(name_or_path))) is not None:
        return oriented(named.make(robot), robot)
    path = drawings().get(str(name_or_path), Path(name_or_path))
    require_regular_file(path, expected="a CSV file", error=MotionError)
    if not path.is_file():
        known = [*MOTIONS.names(), *others, *drawings()]
        raise MotionError(
            f"unknown motion '{name_or_path}': expected one of {names_text(known)}, or {or_file}; "
            f"there is no file of this name{did_you_mean(str(name_or_path), known)}"
        )
    middles = {hand.name: hand.orientation for hand in robot.hands if hand.orientation is not None}
    motion = read_motion_csv(path, robot.hand_names, middles=middles)
    check_targets(motion, robot)
    return motion


def oriented(motion: Motion, robot: RobotConfig) -> Motion:
    """Return a motion of positions alone with the orientations that the hands have in the middle, where these count."""
    if motion.targets.shape[-1] == row_size(robot):
        return motion
    return replace(motion, targets=with_orientations(robot, motion.targets))


def check_targets(motion: Motion, robot: RobotConfig) -> None:
    """Check that a motion's targets can be the robot's; raises MotionError, naming sample and hand."""
    check = range_check(robot)
    for sample, hands in enumerate(motion.targets.tolist()):
        for hand, target in zip(robot.hands, hands, strict=True):
            try:
                check.check_row(hand, target)
            except MessageError as error:
                raise MotionError(
                    f"motion '{motion.name}', sample {sample}, {hand_label(hand.name)}: {error}"
                ) from None


def is_recorded(name_or_path: str | Path) -> bool:
    """Return whether a motion is given as a recording: a log or the parts of a session, and no name of a motion."""
    known = (*MOTIONS.names(), *drawings())
    return str(name_or_path) not in known and is_log(Path(name_or_path))


def read_motion_csv(
    path: str | Path, hands: Sequence[str], *, middles: Mapping[str, Quaternion] = _NO_MIDDLES
) -> Motion:
    """Read an open motion of some hands from a CSV file with the columns `csv_columns` [s, m, world frame].

    Columns are found by name and others are left alone; empty lines and lines that start with # are skipped.

    Parameters
    ----------
    path : str or Path
        The file.
    hands : sequence of str
        Names of the hands.
    middles : mapping of str to (float, float, float, float)
        Orientations of those whose pose is controlled, x, y, z, w, for a file without their `orientation_columns`. If
        there are any, targets are rows of seven numbers, and the orientation of other hands is the identity.

    Raises
    ------
    MotionError
        The file cannot be read, lacks a column, holds something else than finite numbers of a plausible size, has fewer
        than two rows, or its times do not increase; the message names line and column.
    """
    path = Path(path)
    turned = list[str]()

    def choose(header: Sequence[str]) -> Sequence[str]:
        """Choose all columns of positions, and those of orientations that are there."""
        turned.extend(hand for hand in middles if set(orientation_columns(hand)) & set(header))
        columns = [*csv_columns(hands), *(column for hand in turned for column in orientation_columns(hand))]
        if missing := [column for column in columns if column not in header]:
            raise MotionError(f"the header lacks {', '.join(missing)}: expected the columns {','.join(columns)}")
        return columns

    table = read_table(path, choose=choose)
    times_s, positions, orientations = np.split(table, [1, 1 + POSITION_SIZE * len(hands)], axis=1)
    targets = positions.reshape(len(table), len(hands), POSITION_SIZE)
    if middles:
        given = dict(zip(turned, np.split(orientations, max(1, len(turned)), axis=1), strict=False))
        found = [given.get(hand, np.tile(middles.get(hand, _IDENTITY), (len(table), 1))) for hand in hands]
        targets = np.concatenate([targets, np.stack(found, axis=1)], axis=2)
    return Motion(path.stem, times_s[:, 0], targets, closed=False)


def csv_columns(hands: Sequence[str]) -> tuple[str, ...]:
    """Return the columns of a motion of some hands: `t`, and three of each hand.

    Examples
    --------
    >>> csv_columns(["left", "tail"])
    ('t', 'lx', 'ly', 'lz', 'tail_x', 'tail_y', 'tail_z')
    """
    return ("t", *(column for hand in hands for column in hand_columns(hand)))


def hand_columns(hand: str) -> list[str]:
    """Return the columns of a hand's positions: lx,ly,lz of the left, rx,ry,rz of the right, NAME_x and so on else."""
    return [f"{_SHORT.get(hand, f'{hand}_')}{axis}" for axis in "xyz"]


def orientation_columns(hand: str) -> list[str]:
    """Return the columns of a hand's orientation, a quaternion: NAME_qx, NAME_qy, NAME_qz, NAME_qw."""
    return [f"{hand}_q{part}" for part in "xyzw"]
