"""Exploration: the teacher drives the simulated robot through a motion, and the episode goes to a log.

A closed motion goes round once to settle and once for the record; of an open one the first target is held to settle.
The robot takes part in the last `ExplorationConfig.settle_ns` of it alone, see `GuidedRun.settle_placed`. A tick is
written at the start of every hold and one after the last: T + 1 in all. The last tick of a closed motion carries its
first target again, that of an open motion its last.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

from pipeline.exploration.episode import ExplorationConfig, Guidance, GuidedRun, plan, start_posture
from pipeline.exploration.motion_limits import MotionLimits
from pipeline.motions.motion import Motion
from pipeline.robot.backend import LinkPoseSource
from pipeline.robot.config import TOML_FILE, URDF_FILE, RobotConfig
from pipeline.robot.kinematics import Kinematics
from pipeline.robot.telemetry import TopicMessage, hand_messages, state_messages
from pipeline.simulation.simulation import Simulation, SimulationConfig
from pipeline.teacher.teacher import Teacher, TeacherConfig, check_reach
from recorders.messages.message_types import Message, String
from recorders.messages.topics import JOINT_COMMANDS, ROBOT_DESCRIPTION, SAMPLE_JOINTS
from recorders.reading.reader import LogReader
from recorders.writing.writer import LogWriter

_TEACHER, _SIMULATION, _EXPLORATION = TeacherConfig(), SimulationConfig(), ExplorationConfig()
_GUIDANCE = Guidance()
_NOTHING: Mapping[str, Any] = MappingProxyType({})


@dataclass(frozen=True)
class ExplorationResult:
    """Result of an exploration.

    Attributes
    ----------
    path : Path
        The log.
    ticks : int
        Number of ticks in it, one more than the motion has samples.
    teacher_error_cm : float
        Distance of the hands from u(k) at the end of its hold [cm], mean over samples and hands.
    content_sha256 : str
        The log's content hash.
    limit_margin, limit_joint, joint_speed, speed_joint, self_distance_cm, nearest_links : optional
        How near the robot came to its limits while it was recorded, see `LimitsReached`.
    """

    path: Path
    ticks: int
    teacher_error_cm: float
    content_sha256: str
    limit_margin: float
    limit_joint: str
    joint_speed: float
    speed_joint: str
    self_distance_cm: float | None
    nearest_links: tuple[str, str] | None


def explore(
    robot: RobotConfig,
    motion: Motion,
    *,
    seed: int,
    out: str | Path,
    teacher: TeacherConfig = _TEACHER,
    simulation: SimulationConfig = _SIMULATION,
    config: ExplorationConfig = _EXPLORATION,
    guidance: Guidance = _GUIDANCE,
    notes: Mapping[str, Any] = _NOTHING,
    overwrite: bool = False,
    progress: Callable[[float], None] = lambda fraction: None,
    on_message: Callable[[str, Message, int], None] = lambda topic, message, time_ns: None,
) -> ExplorationResult:
    """Let the teacher follow a motion on the simulated robot and write the episode to a log.

    Parameters
    ----------
    robot, motion : RobotConfig and Motion
        Robot that moves, and its motion.
    seed : int
        Seed of the start posture.
    out, overwrite : str or Path, bool
        Log to write, and whether one that is there may be replaced.
    teacher, simulation, config : TeacherConfig, SimulationConfig, ExplorationConfig
        Parameters, all of them written to the manifest.
    guidance : Guidance
        Who leads the robot, and what goes with that.
    notes : mapping of str to object
        More entries of the manifest, such as the source of the motion.
    progress, on_message : callable
        Called with the fraction done, 0 to 1; with every message written, its topic and time [ns].

    Raises
    ------
    MotionError, ConfigError, RobotError, LogError
        If the motion leaves the robot's reach or is sampled faster than the teacher works, the parameters do not fit
        together, the robot cannot be simulated, or the log cannot be written.
    """
    lead = Teacher(Kinematics(robot), teacher)
    if guidance.must_reach:
        check_reach(lead, motion)
    guide = guidance.guide or lead
    motion_plan = plan(motion, period_ns=guide.period_ns, settle_ns=config.settle_ns)
    backend = Simulation(robot, simulation)
    start = start_posture(robot, seed=seed, spread=config.start_spread)
    noise = config.noise(robot, seed=seed, period_ns=guide.period_ns)
    on_hold = _share_of(motion_plan.settling_ns + motion_plan.cycle_ns, progress)
    episode = GuidedRun(backend, guide, start=start, noise=noise, on_hold=on_hold, is_done=guidance.is_done)
    settings = {"teacher": asdict(teacher)} if guidance.guide is None else guidance.settings
    parameters = {**settings, "simulation": asdict(simulation), "exploration": asdict(config)}
    manifest = {**notes, **_description(robot, motion, seed, start.tolist()), **parameters}
    with LogWriter(out, manifest=manifest, attachments=_attachments(robot), overwrite=overwrite) as writer:
        episode.settle_placed(motion_plan, backend, driven_ns=config.settle_ns)  # not for the record
        record = _Record(writer, backend, config.state_period_ns, on_message)
        reached = record.write(episode.cycle(motion_plan), keep_clear=guidance.keep_clear)
    digest = str(LogReader(out).manifest["content_sha256"])
    return ExplorationResult(Path(out), episode.samples + 1, episode.error_cm, digest, **reached)


def _share_of(total_ns: int, progress: Callable[[float], None]) -> Callable[[int], None]:
    """Return a function of the time so far [ns] that passes the fraction done on."""
    return lambda time_ns: progress(time_ns / total_ns)


def _description(robot: RobotConfig, motion: Motion, seed: int, start: list[float]) -> dict[str, Any]:
    return {
        "kind": "exploration",
        "robot": robot.name,
        "motion": {"name": motion.name, "sha256": motion.sha256, "samples": len(motion), "closed": motion.closed},
        "seed": seed,
        "start_posture": start,
    }


def _attachments(robot: RobotConfig) -> dict[str, bytes]:
    return {URDF_FILE: robot.urdf_text.encode(), TOML_FILE: robot.toml_text.encode()}


class _Record:
    """Writes a cycle with the messages of the robot: hands at every tick, its state at its own rate."""

    def __init__(
        self,
        writer: LogWriter,
        backend: LinkPoseSource,
        state_period_ns: int,
        on_message: Callable[[str, Message, int], None],
    ) -> None:
        self._limits = MotionLimits(backend.robot)
        self._writer = writer
        self._backend = backend
        self._period_ns = state_period_ns
        self._on_message = on_message

    def write(self, cycle: Iterator[TopicMessage], *, keep_clear: bool) -> dict[str, Any]:
        """Write the whole cycle; commands, which come far more often, at the rate of the state.

        Parameters
        ----------
        cycle : iterator of topic and message
            The messages; asking for the next drives the robot on.
        keep_clear : bool
            Whether the cycle is refused if hands or forearms come too near to the robot.

        Returns
        -------
        dict of str to object
            How near the robot came to its limits, as `LimitsReached` has it, which is in the manifest, too.
        """
        due_ns = self._backend.time_ns
        self._write(ROBOT_DESCRIPTION, String(self._backend.robot.urdf_text))
        for topic, message in cycle:
            if topic == JOINT_COMMANDS:
                if self._backend.time_ns < due_ns:
                    continue
                self._limits.update(self._backend.positions, self._backend.velocities)
                self._write_all(state_messages(self._backend))
                due_ns += self._period_ns
            self._write(topic, message)
            if topic == SAMPLE_JOINTS:
                self._write_all(hand_messages(self._backend))
        self._write_all(state_messages(self._backend))
        if keep_clear:
            self._limits.check_clearance()
        reached = self._limits.reached._asdict()
        self._writer.note({"limits": reached})
        return reached

    def _write_all(self, messages: Iterable[TopicMessage]) -> None:
        for topic, message in messages:
            self._write(topic, message)

    def _write(self, topic: str, message: Message) -> None:
        self._writer.write(topic, message, log_time_ns=self._backend.time_ns)
        self._on_message(topic, message, self._backend.time_ns)
