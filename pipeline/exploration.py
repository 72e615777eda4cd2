"""Exploration: the teacher drives the simulated robot through a motion, and the episode goes to a log."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pipeline.backend import RobotBackend
from pipeline.kinematics import Kinematics
from pipeline.motions import Motion
from pipeline.robot import TOML_FILE, URDF_FILE, RobotConfig
from pipeline.seeding import uniforms
from pipeline.simulation import Simulation, SimulationConfig
from pipeline.teacher import Teacher, TeacherConfig, check_reach
from pipeline.telemetry import Addressed, command_message, state_messages, tick_messages
from recorders.errors import ConfigError, MotionError
from recorders.messages import String
from recorders.reader import LogReader
from recorders.topics import ROBOT_DESCRIPTION
from recorders.writer import LogWriter

Floats = NDArray[np.float64]

_TEACHER, _SIMULATION = TeacherConfig(), SimulationConfig()


@dataclass(frozen=True)
class ExplorationConfig:
    """How an episode is recorded.

    Attributes
    ----------
    state_period_ns : period of the robot's own messages [ns]; the default is 50 Hz
    settle_ns : how long the first target of an open motion is held before the recording [ns]; a closed motion settles
        during one unrecorded cycle
    start_spread : the start posture is drawn this far about the comfort posture, in parts of each joint's range
    """

    state_period_ns: int = 20_000_000
    settle_ns: int = 2_000_000_000
    start_spread: float = 0.05

    def __post_init__(self) -> None:
        if self.state_period_ns <= 0 or self.settle_ns < 0:
            raise ConfigError("exploration: expected state_period_ns above 0 and settle_ns at least 0")
        if not 0.0 <= self.start_spread <= 0.5:
            raise ConfigError(f"exploration start_spread: expected 0 to 0.5, found {self.start_spread}")


_EXPLORATION = ExplorationConfig()


@dataclass(frozen=True)
class Exploration:
    """What an exploration left behind.

    Attributes
    ----------
    path : the log
    ticks : number of ticks in it, one more than the motion has samples
    teacher_error_cm : distance of the hands from u(k) at the end of its hold [cm], mean over samples and hands
    content_sha256 : the log's content hash
    """

    path: Path
    ticks: int
    teacher_error_cm: float
    content_sha256: str


class Hold(NamedTuple):
    """A target (2, 3) [m] that is held for a while."""

    target: Floats
    duration_ns: int


def explore(
    robot: RobotConfig,
    motion: Motion,
    *,
    seed: int,
    out: str | Path,
    teacher: TeacherConfig = _TEACHER,
    simulation: SimulationConfig = _SIMULATION,
    config: ExplorationConfig = _EXPLORATION,
    overwrite: bool = False,
    progress: Callable[[float], None] = lambda fraction: None,
) -> Exploration:
    """Let the teacher follow a motion on the simulated robot and write the episode to a log.

    A closed motion goes round once to settle and once for the record; of an open one the first target is held to
    settle. A tick is written at the start of every hold and one after the last: T + 1 in all. The last tick of a closed
    motion carries its first target again, that of an open motion its last.

    Parameters
    ----------
    robot, motion : what moves, and how
    seed : names the start posture
    out : path of the log
    teacher, simulation, config : parameters, all of them written to the manifest
    overwrite : whether a log at `out` may be replaced
    progress : called with the fraction done, 0 to 1

    Raises
    ------
    MotionError
        The motion leaves the robot's reach, or is sampled faster than the teacher works.
    ConfigError, RobotError, LogError
        The parameters do not fit together, the robot cannot be simulated, or the log cannot be written.
    """
    guide = Teacher(Kinematics(robot), teacher)
    holds = _holds(motion, teacher.period_ns)
    check_reach(guide, motion)
    backend = Simulation(robot, simulation)
    start = start_posture(robot, seed=seed, spread=config.start_spread)
    backend.reset(start)
    manifest = {
        "kind": "exploration",
        "robot": robot.name,
        "motion": {"name": motion.name, "sha256": motion.sha256, "samples": len(motion), "closed": motion.closed},
        "seed": seed,
        "start_posture": start.tolist(),
        "teacher": asdict(teacher),
        "simulation": asdict(simulation),
        "exploration": asdict(config),
    }
    with LogWriter(out, manifest=manifest, attachments=_attachments(robot), overwrite=overwrite) as writer:
        episode = _Episode(backend, guide, start, config)
        settling = holds if motion.closed else [Hold(motion.targets[0], config.settle_ns)]
        total_ns = sum(hold.duration_ns for hold in [*settling, *holds])
        closing = motion.targets[0 if motion.closed else -1]
        episode.settle(settling, lambda time_ns: progress(time_ns / total_ns))
        error_cm = episode.record(holds, closing, writer, lambda time_ns: progress(time_ns / total_ns))
    return Exploration(Path(out), len(motion) + 1, error_cm, str(LogReader(out).manifest["content_sha256"]))


def start_posture(robot: RobotConfig, *, seed: int, spread: float) -> Floats:
    """Draw the posture (n,) that `seed` names, near the comfort posture and within the limits."""
    span = robot.upper - robot.lower
    drawn = uniforms(seed, "start posture", count=len(robot.joints))
    posture = robot.comfort + spread * span * (2.0 * drawn - 1.0)
    return np.clip(posture, robot.lower + 0.01 * span, robot.upper - 0.01 * span)


def _attachments(robot: RobotConfig) -> dict[str, bytes]:
    return {URDF_FILE: robot.urdf_text.encode(), TOML_FILE: robot.toml_text.encode()}


def _holds(motion: Motion, period_ns: int) -> list[Hold]:
    """Hold each sample until the next, in whole periods of the teacher, and the last as long as the one before."""
    steps = np.rint((motion.times_s - motion.times_s[0]) * 1e9 / period_ns).astype(np.int64)
    durations = np.diff(steps) * period_ns
    if durations.min() <= 0:
        sample = int(np.argmin(durations)) + 1
        raise MotionError(
            f"motion '{motion.name}': samples {sample - 1} and {sample} are closer than the teacher's period of "
            f"{period_ns / 1e6:g} ms"
        )
    return [Hold(target, int(d)) for target, d in zip(motion.targets, [*durations, durations[-1]], strict=True)]


class _Episode:
    """One run of the robot: settling, then the record."""

    def __init__(self, backend: RobotBackend, teacher: Teacher, start: Floats, config: ExplorationConfig) -> None:
        self._backend = backend
        self._teacher = teacher
        self._command = start
        self._config = config

    def settle(self, holds: list[Hold], progress: Callable[[int], None]) -> None:
        """Follow `holds` and write nothing."""
        for hold in holds:
            for _ in self._follow(hold):
                pass
            progress(self._backend.time_ns)

    def record(self, holds: list[Hold], closing: Floats, writer: LogWriter, progress: Callable[[int], None]) -> float:
        """Follow `holds`, write everything, end with a tick of the `closing` target; the teacher's mean error [cm]."""
        errors_m: list[float] = []
        state_due_ns = self._backend.time_ns
        self._write(writer, [(ROBOT_DESCRIPTION, String(self._backend.robot.urdf_text))])
        for hold in holds:
            self._write(writer, tick_messages(self._backend, hold.target))
            for command in self._follow(hold):
                if self._backend.time_ns >= state_due_ns:
                    self._write(writer, [*state_messages(self._backend), command_message(self._backend, command)])
                    state_due_ns += self._config.state_period_ns
            errors_m.extend(np.linalg.norm(self._backend.hands() - hold.target, axis=1).tolist())
            progress(self._backend.time_ns)
        self._write(writer, tick_messages(self._backend, closing))
        self._write(writer, state_messages(self._backend))
        return 100.0 * sum(errors_m) / len(errors_m)

    def _follow(self, hold: Hold) -> Iterator[Floats]:
        """Drive the robot towards a target while it is held, and yield each command before it takes effect."""
        period_ns = self._teacher.config.period_ns
        for _ in range(hold.duration_ns // period_ns):
            self._command = self._teacher.step(self._command, hold.target)
            yield self._command
            self._backend.advance(self._command, period_ns)

    def _write(self, writer: LogWriter, messages: Iterable[Addressed]) -> None:
        for topic, message in messages:
            writer.write(topic, message, log_time_ns=self._backend.time_ns)
