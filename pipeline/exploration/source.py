"""Source of an exploration: the motion that the teacher follows, and the settings that go with it."""

from collections.abc import Callable
from dataclasses import dataclass, replace

from pipeline.exploration.episode import ExplorationConfig
from pipeline.exploration.via_points import VOLUME, volume
from pipeline.motions.motion import Motion, load_motion
from pipeline.robot.config import RobotConfig
from pipeline.robot.kinematics import Kinematics
from pipeline.teacher.teacher import Teacher, TeacherConfig
from recorders.errors import ConfigError

_SECOND_NS = 1_000_000_000


@dataclass(frozen=True)
class Pace:
    """Length and rate of a motion that is made as long as wanted.

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


@dataclass(frozen=True)
class Source:
    """A motion by name, made for a robot, and how it is explored.

    Attributes
    ----------
    name : str
        The motion: `volume`, a pattern or drawing by name, or a CSV file by path.
    pace : Pace
        Of `volume`; other motions have their own.
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
        return self.name == VOLUME

    def motion(
        self, robot: RobotConfig, *, seed: int, progress: Callable[[float], None] = lambda fraction: None
    ) -> Motion:
        """Return the motion for a robot; `progress` is called with the fraction made, 0 to 1.

        Raises
        ------
        MotionError
            It is unknown, its file is malformed, or no way is found that keeps the hands clear of the body.
        """
        if self.drawn:
            teacher = Teacher(Kinematics(robot), self.teacher)
            duration_ns = round(self.pace.duration_s * _SECOND_NS)
            noise = self.config.noise(robot, seed=seed, period_ns=self.teacher.period_ns)
            return volume(
                teacher,
                seed=seed,
                duration_ns=duration_ns,
                tick_ns=self.pace.tick_ns,
                noise=noise,
                progress=progress,
            )
        return load_motion(self.name, robot)


def source(
    name: str, *, duration_s: float | None = None, tick_rate_hz: int | None = None, comfort_gain: float | None = None
) -> Source:
    """Return the source of an exploration; what is None has the default of this motion.

    Raises
    ------
    ConfigError
        A value is out of its range, or the motion has its own duration and rate.
    """
    given = {"duration_s": duration_s, "tick_rate_hz": tick_rate_hz}
    wanted = {key: value for key, value in given.items() if value is not None}
    if wanted and name != VOLUME:
        raise ConfigError(f"motion '{name}' has its own duration and tick rate; only '{VOLUME}' is made to measure")
    teacher, config = TeacherConfig(), ExplorationConfig()
    if (
        name == VOLUME
    ):  # the least lag in the null space, and joints that vary on their own: what a model is learned from
        teacher, config = replace(teacher, comfort_gain=20.0, speed_share=0.7), replace(config, joint_noise=0.01)
    if comfort_gain is not None:
        teacher = replace(teacher, comfort_gain=comfort_gain)
    return Source(name, Pace(**wanted), teacher, config)  # type: ignore[arg-type]
