"""Demonstrations: paths of a person's hands, placed before the robot and followed by it like any other motion."""

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.arrays import Floats
from pipeline.exploration.episode import Guidance
from pipeline.exploration.explore import explore
from pipeline.exploration.hand_paths import DemonstratedPaths
from pipeline.exploration.pose_track import HandPath
from pipeline.exploration.via_points import MOVE_NS
from pipeline.motions.motion import Motion, check_targets
from pipeline.motions.shown_turns import are_orientations, inputs_of, shown_turns
from pipeline.motions.smoothing import peak_jerk, resampled, smoothed
from pipeline.motions.source_axes import robot_plane, source_axes, world_axes
from pipeline.robot.config import RobotConfig
from pipeline.robot.coordinates import POSITION_SIZE, to_rows
from pipeline.robot.hands import Hand
from pipeline.robot.kinematics import Kinematics
from pipeline.robot.range_check import range_check
from pipeline.teacher.reach import CHOICES, OutOfReach, bring_within_reach
from pipeline.teacher.teacher import Teacher
from recorders.errors import ConfigError, MessageError, MotionError
from recorders.text.wording import names_text

MAX_SAMPLES = 100_000
"""Most samples of a demonstration, close to three hours at 10 Hz: a wrong stamp must not fill the memory."""

MAX_SMOOTH_S = 1.0
"""Longest window of smoothing [s]: a longer one leaves little of what was shown."""

ALIGNMENTS = ("centre", "as-is")

_WIDER = 1.5  # the window after one in which a jerk is beyond the limit
_LEAST_SLOWER = 1.05  # from try to try, once no window helps
_MINIMUM_JERK_PEAK = 60.0  # largest jerk of a minimum-jerk movement, over its length and its time's third power


@dataclass(frozen=True)
class DemonstrationConfig:
    """Conversion of demonstrated paths to targets.

    Parameters
    ----------
    hz : float
        Samples a second.
    align : str
        Where the middle of each hand's path goes: to the `centre` of the hand's pattern, or nowhere, `as-is`.
    scale : float
        Enlarges each path about its middle; brings it to metres if it is in another unit.
    plane : tuple of str, optional
        The axes of the source, such as ("-x", "y"), that point to the robot's left and up, as its configuration calls
        the plane in which it draws (`lateral` and `up`). Left out: the source has the axes of the robot's world.
    project_to_plane : bool
        Whether the paths are flattened into that plane.
    on_unreachable : str
        What becomes of samples out of reach, one of `pipeline.teacher.reach.CHOICES`.
    smooth_s : float
        Length of the window in which each path is smoothed [s], before it is followed at a jerk that the robot can
        follow; 0 leaves the paths as they were shown, interpolated linearly.

    Raises
    ------
    ConfigError
        If a value is none of those.
    """

    hz: float = 10.0
    align: str = "centre"
    scale: float = 1.0
    plane: tuple[str, str] | None = None
    project_to_plane: bool = False
    on_unreachable: str = "refuse"
    smooth_s: float = 0.3

    def __post_init__(self) -> None:
        for name in ("hz", "scale"):
            if not 0.0 < getattr(self, name) < math.inf:
                raise ConfigError(f"{name}: expected above 0, found {getattr(self, name):g}")
        if not 0.0 <= self.smooth_s <= MAX_SMOOTH_S:
            raise ConfigError(f"smooth: expected 0 to {MAX_SMOOTH_S:g} s, found {self.smooth_s:g}")
        for name, choices in (("align", ALIGNMENTS), ("on_unreachable", CHOICES)):
            if getattr(self, name) not in choices:
                raise ConfigError(f"{name}: expected one of {', '.join(choices)}, found '{getattr(self, name):.40}'")
        if self.plane is not None:
            source_axes(self.plane)

    def manifest_entry(self) -> dict[str, Any]:
        """Return the settings under the keys that manifests of logs have for them."""
        return {
            "hz": self.hz,
            "place": self.align,
            "scale": self.scale,
            "plane": self.plane,
            "flat": self.project_to_plane,
            "unreachable": self.on_unreachable,
            "smooth_s": self.smooth_s,
        }


@dataclass(frozen=True)
class Smoothing:
    """Smoothing of demonstrated paths.

    Attributes
    ----------
    windows_s : dict of str to float
        Length of the window by hand [s]; 0 where a path was not smoothed: not asked for, or too few samples.
    slowed : float
        How much longer the motion takes than what was shown; 1 if the robot can follow as it was shown.
    jerk_m_s3, jerk_limit_m_s3 : float
        Largest jerk of a hand's target, and the largest that the robot is asked to follow [m/s^3].
    """

    windows_s: dict[str, float]
    slowed: float
    jerk_m_s3: float
    jerk_limit_m_s3: float


@dataclass(frozen=True)
class DemonstrationResult:
    """Result of a demonstration.

    Attributes
    ----------
    path : Path
        The log.
    ticks : int
        Number of ticks in it.
    duration_s : float
        How long the motion takes [s].
    peak_m_s : float
        The highest speed of a hand's target [m/s].
    longest_gap_s : float
        The longest time between two poses shown, across which was interpolated [s].
    smoothing : Smoothing
        How it was smoothed.
    out_of_reach : OutOfReach
        What of it was, and what became of that.
    source : dict of str to object
        Where it came from, as in the manifest.
    teacher_error_cm : float
        Distance of the hands from u(k) at the end of its hold [cm], mean over samples and hands.
    content_sha256 : str
        The log's content hash.
    """

    path: Path
    ticks: int
    duration_s: float
    peak_m_s: float
    longest_gap_s: float
    smoothing: Smoothing
    out_of_reach: OutOfReach
    source: dict[str, Any]
    teacher_error_cm: float
    content_sha256: str

    def to_dict(self) -> dict[str, Any]:
        """Return it as JSON has it."""
        return asdict(self) | {"path": str(self.path)}


def demonstrate(
    robot: RobotConfig,
    shown: DemonstratedPaths,
    *,
    config: DemonstrationConfig,
    seed: int,
    out: str | Path,
    overwrite: bool = False,
    progress: Callable[[float], None] = lambda fraction: None,
) -> DemonstrationResult:
    """Record an episode of demonstrated paths: teacher and simulated robot follow them, as in `exploration.explore`.

    Parameters
    ----------
    robot : RobotConfig
        Robot that follows.
    shown : DemonstratedPaths
        Paths of some of the hands; a hand that is not shown is held still in the centre of its pattern. Where the pose
        is controlled and no orientation is shown, it is that in the middle.
    config : DemonstrationConfig
        Placement of the paths in the workspace.
    seed : int
        Seed of the start posture.
    out, overwrite : str or Path, bool
        Log to write, and whether one that is there may be replaced.
    progress : callable
        Called with the fraction done, 0 to 1.

    Raises
    ------
    MotionError, ConfigError, RobotError, LogError
        If the paths do not make a motion or leave the robot's reach; and as `explore` does.
    """
    placed, smoothing = _prepared(robot, shown, config)
    check_targets(placed, robot)
    motion, found = bring_within_reach(Teacher(Kinematics(robot)), placed, choice=config.on_unreachable)
    treated: dict[str, Any] = {"smoothing": asdict(smoothing), "out_of_reach": asdict(found)}
    treated |= {"orientations": list(turned)} if (turned := turned_hands(robot, shown)) else {}
    explored = explore(
        robot,
        motion,
        seed=seed,
        out=out,
        guidance=Guidance(must_reach=False),
        notes={"demonstration": {**shown.source, **config.manifest_entry(), **treated}},
        overwrite=overwrite,
        progress=progress,
    )
    return DemonstrationResult(
        path=explored.path,
        ticks=explored.ticks,
        duration_s=float(motion.times_s[-1] - motion.times_s[0]),
        peak_m_s=_peak_m_s(motion),
        longest_gap_s=max(float(np.diff(path.times_s).max()) for path in shown.paths.values()),
        smoothing=smoothing,
        out_of_reach=found,
        source=dict(shown.source),
        teacher_error_cm=explored.teacher_error_cm,
        content_sha256=explored.content_sha256,
    )


def _peak_m_s(motion: Motion) -> float:
    speeds = (
        np.linalg.norm(np.diff(motion.targets[..., :POSITION_SIZE], axis=0), axis=2) / np.diff(motion.times_s)[:, None]
    )
    return float(speeds.max())


def to_motion(robot: RobotConfig, shown: DemonstratedPaths, *, config: DemonstrationConfig) -> Motion:
    """Smooth, resample, turn, scale and place demonstrated paths.

    Samples are taken while every hand shown has poses on both sides of them. Targets are rounded to the nanometre,
    which hides the last bits of what smoothed them.

    Raises
    ------
    MotionError
        There is less than one sample's time in which all hands are shown, more than `MAX_SAMPLES` of them, or a path
        ends up beyond all reach.
    """
    return _prepared(robot, shown, config)[0]


def _prepared(robot: RobotConfig, shown: DemonstratedPaths, config: DemonstrationConfig) -> tuple[Motion, Smoothing]:
    """Return the motion of demonstrated paths, and how they were smoothed.

    Windows grow, and then the motion slows, until the jerk of no hand is beyond the largest of an exploration of the
    robot's boxes.
    """
    limit = _jerk_limit(robot)
    window_s, slowed = config.smooth_s, 1.0
    while True:
        motion, windows_s = _motion(robot, shown, config, window_s, slowed)
        jerk = peak_jerk(motion.targets[..., :POSITION_SIZE], 1.0 / config.hz)
        if not config.smooth_s or jerk <= limit:
            return motion, Smoothing(windows_s, slowed, jerk, limit)
        if _WIDER * window_s <= MAX_SMOOTH_S:
            window_s *= _WIDER
        else:
            slowed *= max(_LEAST_SLOWER, float(np.cbrt(jerk / limit)))


def _jerk_limit(robot: RobotConfig) -> float:
    """Return the largest jerk of a move through a hand's box in an exploration of the volume [m/s^3]."""
    longest_m = 2.0 * float(np.linalg.norm(robot.boxes, axis=1).min())
    return _MINIMUM_JERK_PEAK * longest_m / (MOVE_NS * 1e-9) ** 3


def _motion(
    robot: RobotConfig, shown: DemonstratedPaths, config: DemonstrationConfig, window_s: float, slowed: float
) -> tuple[Motion, dict[str, float]]:
    """Return the motion of paths that are smoothed in a window and slowed, and the windows used by hand [s]."""
    times_s = _sample_times(shown, config.hz * slowed)
    hands, windows_s = [], {}
    for side, centre in zip(robot.hand_names, robot.centres, strict=True):
        path = shown.paths.get(side)
        if path is None:
            hands.append(np.broadcast_to(centre, (len(times_s), 3)))
        else:
            points, windows_s[side] = _sampled(path, times_s, window_s)
            placed = _place(points, robot, centre, config)
            _check_extent(shown.name, placed, robot)
            hands.append(np.round(placed, 9))
    # To the nanosecond: k / hz is not a number of them for every rate.
    even_s = np.round((times_s - times_s[0]) * slowed, 9)
    turns = {
        name: np.round(_turned(robot, shown.name, hand, path, times_s, config, window_s), 9)
        for name, (hand, path) in turned_hands(robot, shown).items()
    }
    rows = to_rows(robot, inputs_of(robot, hands, turns))
    return Motion(shown.name, even_s, rows, closed=False), windows_s


def turned_hands(robot: RobotConfig, shown: DemonstratedPaths) -> dict[str, tuple[Hand, HandPath]]:
    """Return the hands whose pose is controlled and of which two orientations or more are shown, each with these."""
    found = {}
    for hand in robot.hands:
        path = shown.paths.get(hand.name)
        if hand.orientation is None or path is None or path.quaternions is None:
            continue
        there = are_orientations(path.quaternions)
        if there.sum() > 1:
            found[hand.name] = hand, HandPath(path.times_s[there], path.points[there], path.quaternions[there])
    return found


def _turned(
    robot: RobotConfig,
    name: str,
    hand: Hand,
    path: HandPath,
    times_s: Floats,
    config: DemonstrationConfig,
    window_s: float,
) -> Floats:
    """Return the turns of a hand [rad], shape (T, 3); before its first orientation and after the last they stay."""
    assert path.quaternions is not None  # noqa: S101  # of a hand that is turned
    assert hand.orientation is not None  # noqa: S101
    try:
        return shown_turns(
            path.times_s,
            path.quaternions,
            np.clip(times_s, path.times_s[0], path.times_s[-1]),
            window_s=window_s,
            axes=world_axes(robot, config.plane),
            middle=hand.orientation,
            centred=config.align == "centre",
        )
    except MotionError as error:
        raise MotionError(f"{name}, {hand.name}: {error}") from None


def _check_extent(name: str, points: Floats, robot: RobotConfig) -> None:
    """Check that a path, shape (T, 3), can be one of the robot's hands in metres."""
    try:
        range_check(robot).check_extent(float((points.max(axis=0) - points.min(axis=0)).max()) / 2.0)
    except MessageError as error:
        raise MotionError(f"{name}: {error}; bring it to metres with --scale") from None


def _sample_times(shown: DemonstratedPaths, hz: float) -> Floats:
    begin_s = max(float(path.times_s[0]) for path in shown.paths.values())
    end_s = min(float(path.times_s[-1]) for path in shown.paths.values())
    steps = (end_s - begin_s) * hz
    if steps < 1.0 - 1e-6:
        both = f" in which {names_text(shown.paths)} are shown" if len(shown.paths) > 1 else ""
        raise MotionError(f"{shown.name}: expected at least {1 / hz:g} s{both}, found {max(0.0, end_s - begin_s):g} s")
    if steps >= MAX_SAMPLES:
        raise MotionError(
            f"{shown.name}: expected at most {MAX_SAMPLES} samples at {hz:g} Hz, "
            f"found a first and last time {end_s - begin_s:g} s apart"
        )
    return begin_s + np.arange(int(steps + 1e-6) + 1) / hz


def _sampled(path: HandPath, times_s: Floats, window_s: float) -> tuple[Floats, float]:
    """Return a path at other times, smoothed in a window, (T, 3), and the window used [s]; 0 interpolates only."""
    if not window_s:
        return np.stack([np.interp(times_s, path.times_s, path.points[:, axis]) for axis in range(3)], axis=1), 0.0
    even_s, points, used_s = smoothed(path.times_s, path.points, window_s)
    return resampled(even_s, points, times_s), used_s


def _place(points: Floats, robot: RobotConfig, centre: Floats, config: DemonstrationConfig) -> Floats:
    """Turn, flatten, scale and move a path, shape (T, 3)."""
    plane = robot_plane(robot)
    turned = points if config.plane is None else points @ source_axes(config.plane).T @ plane
    middle = (turned.min(axis=0) + turned.max(axis=0)) / 2
    offsets = turned - middle
    if config.project_to_plane:
        offsets = offsets - np.outer(offsets @ plane[2], plane[2])
    placed: Floats = (centre if config.align == "centre" else middle) + config.scale * offsets
    return placed
