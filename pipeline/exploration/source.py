"""Source of an exploration: the motion that the teacher follows, and the settings that go with it."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any, Protocol

from pipeline.arrays import Floats
from pipeline.exploration import sources
from pipeline.exploration.episode import ExplorationConfig, Guidance, Guide
from pipeline.exploration.leader import TEACHERS, leader_settings, make_guide
from pipeline.exploration.self_explorer import SelfExplorer, SelfExplorerConfig
from pipeline.exploration.via_points import VOLUME, unplanned_volume
from pipeline.motions.motion import Motion, load_motion, oriented
from pipeline.robot.config import RobotConfig
from pipeline.robot.kinematics import Kinematics
from pipeline.teacher.qp_config import QpTeacherConfig
from pipeline.teacher.teacher import Teacher, TeacherConfig
from recorders.errors import ConfigError
from recorders.messages.phase import LEARN
from recorders.registry import Registry
from recorders.text.wording import names_text
from replay.sources.schedule import Schedule

JOINT_NOISE = 0.01
"""Of explorations that a model is learned from, in parts of each joint's range: joints vary on their own."""

_SELF_TICK_RATE_HZ = 25
_SECOND_NS = 1_000_000_000
_TEACHER, _EXPLORATION = TeacherConfig(), ExplorationConfig()


@dataclass(frozen=True)
class Pace:
    """Length and rate of a motion that is as long as wanted.

    Attributes
    ----------
    duration_s : float
        Length [s].
    tick_rate_hz : int
        Targets, and ticks of the log, in a second: 5 to 50.
    """

    duration_s: float = 120.0
    tick_rate_hz: int = 5

    def __post_init__(self) -> None:
        if not 1.0 <= self.duration_s <= 14_400.0:
            raise ConfigError(f"duration of an exploration: expected 1 to 14400 s, found {self.duration_s:g} s")
        if not 5 <= self.tick_rate_hz <= 50 or _SECOND_NS % self.tick_rate_hz:
            raise ConfigError(
                f"rate of an exploration's ticks: expected a whole part of a second, 5 to 50 Hz (5, 8, 10, 20, 25, 40, "
                f"50), found {self.tick_rate_hz} Hz"
            )

    @property
    def tick_ns(self) -> int:
        """Time from one tick to the next [ns]."""
        return _SECOND_NS // self.tick_rate_hz


class Draw(Protocol):
    """Draws a motion at random, to measure."""

    def __call__(
        self,
        teacher: Teacher,
        *,
        seed: int,
        duration_ns: int,
        tick_ns: int,
        noise: Iterator[Floats] | None,
        progress: Callable[[float], None],
    ) -> Motion:
        """Return a motion within reach of the teacher, which follows it with `noise` (n,) added to its commands.

        The seed names the draws; the motion lasts `duration_ns` [ns], with a sample every `tick_ns` [ns]; `progress` is
        called with the fraction done, 0 to 1.
        """


@dataclass(frozen=True)
class DrawnMotion:
    """Motion that is drawn for an exploration, of any length and rate, within reach and clear of the robot's body.

    A source is a module with `SOURCE`: here in `pipeline.exploration.sources`, named as it is, or in a distribution of
    others, under an entry point of the group `reenact.explorations`. `pipeline.exploration.contract` has tests for it.
    Motions that are always the same are a seam of their own, `pipeline.motions.motion.NamedMotion`.

    Parameters
    ----------
    name : str
        Its name.
    draw : callable
        Draws it.
    teacher, config : TeacherConfig, ExplorationConfig
        Settings that go with it, unless others are asked for.
    """

    name: str
    draw: Draw
    teacher: TeacherConfig = _TEACHER
    config: ExplorationConfig = _EXPLORATION


SOURCES = Registry("exploration source", DrawnMotion, room=sources, constant="SOURCE", group="reenact.explorations")


@dataclass(frozen=True)
class Source:
    """A motion by name, for a robot, and how it is explored.

    Attributes
    ----------
    name : str
        The motion: one that is drawn, or one known by name, or a CSV file by path.
    pace : Pace
        Of a motion that is drawn; others have their own.
    teacher, config : TeacherConfig, ExplorationConfig
        Settings of the exploration.
    qp : QpTeacherConfig or None
        Settings of the second teacher, if it leads in place of the first.
    explorer : SelfExplorerConfig or None
        Settings of the learner that explores by itself, if no teacher leads.
    until_cm : float or None
        Error [cm] that this learner expects of itself when it has explored enough; None to go on to the end.
    """

    name: str
    pace: Pace
    teacher: TeacherConfig
    config: ExplorationConfig
    qp: QpTeacherConfig | None = None
    explorer: SelfExplorerConfig | None = None
    until_cm: float | None = None

    @property
    def settings(self) -> dict[str, Any]:
        """Settings of who leads, for the manifest and the name of a session."""
        return leader_settings(self.explorer or self.qp or self.teacher)

    @property
    def keeps_clear(self) -> bool:
        """Whether the motion is planned to keep the hands clear of the robot's body."""
        return self.drawn and self.explorer is None

    @property
    def drawn(self) -> bool:
        """Whether the motion is drawn at random."""
        return SOURCES.get(self.name) is not None

    def motion(
        self, robot: RobotConfig, *, seed: int, progress: Callable[[float], None] = lambda fraction: None
    ) -> Motion:
        """Return the motion for a robot; `progress` is called with the fraction done, 0 to 1.

        Raises
        ------
        MotionError
            It is unknown, its file is malformed, or no way is found that keeps the hands clear of the body.
        """
        if (drawn := SOURCES.get(self.name)) is None:
            return load_motion(self.name, robot, others=SOURCES.names())
        duration_ns, tick_ns = round(self.pace.duration_s * _SECOND_NS), self.pace.tick_ns
        if self.explorer is not None:
            return unplanned_volume(robot, seed=seed, duration_ns=duration_ns, tick_ns=tick_ns)
        motion = drawn.draw(
            Teacher(Kinematics(robot), self.teacher),
            seed=seed,
            duration_ns=duration_ns,
            tick_ns=tick_ns,
            noise=self.config.noise(robot, seed=seed, period_ns=self.teacher.period_ns),
            progress=progress,
        )
        return oriented(motion, robot)

    def guide(self, robot: RobotConfig, *, seed: int) -> Guide:
        """Return who leads a robot: one of the teachers, or the learner that explores by itself."""
        return make_guide(robot, self.explorer or self.qp or self.teacher, seed=seed)

    def guidance(self, robot: RobotConfig, *, seed: int) -> Guidance:
        """Return who leads a robot, and what goes with that."""
        guide = self.guide(robot, seed=seed)
        return Guidance(
            guide,
            self.settings,
            is_done=self.until(guide),
            must_reach=not self.drawn,
            keep_clear=self.keeps_clear,
        )

    def schedule(self, *, epochs: int) -> Schedule:
        """Return the schedule of a live session: what is drawn is learned once, in each epoch."""
        return Schedule(epochs=epochs, phases=((LEARN, 1),)) if self.drawn else Schedule(epochs=epochs)

    def until(self, guide: Guide) -> Callable[[], bool]:
        """Return a check of whether a guide has explored enough; never, unless it expects an error of itself."""
        if isinstance(guide, SelfExplorer) and self.until_cm is not None:
            return guide.until(self.until_cm)
        return lambda: False


def source(
    name: str,
    *,
    duration_s: float | None = None,
    tick_rate_hz: int | None = None,
    comfort_gain: float | None = None,
    teacher: str = TEACHERS[0],
) -> Source:
    """Return the source of an exploration by one of `TEACHERS`; what is None has the default of this motion.

    A motion that is drawn is drawn for the first teacher, whichever leads.

    Raises
    ------
    ConfigError
        A value is out of its range, the motion has its own duration and rate, or what is installed under its name is
        none.
    """
    wanted = _given(duration_s=duration_s, tick_rate_hz=tick_rate_hz)
    drawn = SOURCES.get(name)
    if wanted and drawn is None:
        measured = names_text(f"'{known}'" for known in SOURCES.names())
        raise ConfigError(f"motion '{name}' has its own duration and tick rate; only {measured} is made to measure")
    if teacher not in TEACHERS:
        raise ConfigError(f"teacher of an exploration: expected one of {', '.join(TEACHERS)}, found '{teacher:.40}'")
    first, config = (_TEACHER, _EXPLORATION) if drawn is None else (drawn.teacher, drawn.config)
    if comfort_gain is not None:
        first = replace(first, comfort_gain=comfort_gain)
    qp = QpTeacherConfig(comfort_gain=first.comfort_gain) if teacher == "qp" else None
    return Source(name, Pace(**wanted), first, config, qp)  # type: ignore[arg-type]


def self_exploration(
    *, duration_s: float | None = None, tick_rate_hz: int | None = None, until_cm: float | None = None
) -> Source:
    """Return the source of an exploration without a teacher, for 120 s with ticks at 25 Hz unless told otherwise.

    Raises
    ------
    ConfigError
        A value is out of its range.
    """
    wanted = _given(duration_s=duration_s, tick_rate_hz=tick_rate_hz)
    if until_cm is not None and not until_cm > 0.0:
        raise ConfigError(f"error at which exploring ends: expected above 0 cm, found {until_cm:g} cm")
    pace = Pace(**{"tick_rate_hz": _SELF_TICK_RATE_HZ, **wanted})  # type: ignore[arg-type]
    explorer = SelfExplorerConfig(period_ns=pace.tick_ns)
    return Source(VOLUME, pace, _TEACHER, ExplorationConfig(joint_noise=JOINT_NOISE), None, explorer, until_cm)


def _given(**values: float | None) -> dict[str, float]:
    """Return the values that are not None."""
    return {name: value for name, value in values.items() if value is not None}
