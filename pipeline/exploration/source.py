"""Source of an exploration: the motion that the teacher follows, and the settings that go with it."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Protocol

from pipeline.arrays import Floats
from pipeline.exploration import sources
from pipeline.exploration.episode import ExplorationConfig
from pipeline.motions.motion import Motion, load_motion
from pipeline.robot.config import RobotConfig
from pipeline.robot.kinematics import Kinematics
from pipeline.teacher.teacher import Teacher, TeacherConfig
from recorders.errors import ConfigError
from recorders.registry import Registry
from recorders.text.wording import names_text

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
    """

    name: str
    pace: Pace
    teacher: TeacherConfig
    config: ExplorationConfig

    @property
    def drawn(self) -> bool:
        """Whether the motion is drawn at random, within reach and clear of the robot's body."""
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
            return load_motion(self.name, robot)
        return drawn.draw(
            Teacher(Kinematics(robot), self.teacher),
            seed=seed,
            duration_ns=round(self.pace.duration_s * _SECOND_NS),
            tick_ns=self.pace.tick_ns,
            noise=self.config.noise(robot, seed=seed, period_ns=self.teacher.period_ns),
            progress=progress,
        )


def source(
    name: str, *, duration_s: float | None = None, tick_rate_hz: int | None = None, comfort_gain: float | None = None
) -> Source:
    """Return the source of an exploration; what is None has the default of this motion.

    Raises
    ------
    ConfigError
        A value is out of its range, the motion has its own duration and rate, or what is installed under its name is
        none.
    """
    given = {"duration_s": duration_s, "tick_rate_hz": tick_rate_hz}
    wanted = {key: value for key, value in given.items() if value is not None}
    drawn = SOURCES.get(name)
    if wanted and drawn is None:
        measured = names_text(f"'{known}'" for known in SOURCES.names())
        raise ConfigError(f"motion '{name}' has its own duration and tick rate; only {measured} is made to measure")
    teacher, config = (_TEACHER, _EXPLORATION) if drawn is None else (drawn.teacher, drawn.config)
    if comfort_gain is not None:
        teacher = replace(teacher, comfort_gain=comfort_gain)
    return Source(name, Pace(**wanted), teacher, config)  # type: ignore[arg-type]
