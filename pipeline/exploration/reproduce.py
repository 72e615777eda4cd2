"""Reproduction of an exploration from its log: teacher and simulation of today follow the logged targets."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.arrays import Floats
from pipeline.exploration.episode import ExplorationConfig, GuidedRun, MotionPlan, TargetHold, start_posture
from pipeline.exploration.leader import Leader, leader_of, make_guide
from pipeline.robot.config import RobotConfig, load_robot, robot_names
from pipeline.robot.coordinates import row_size
from pipeline.robot.recorded import require_recorded_robot
from pipeline.robot.resolution import UNLIMITED
from pipeline.robot.telemetry import TopicMessage, hand_messages
from pipeline.simulation.simulation import Simulation, SimulationConfig
from pipeline.teacher.qp_config import SOLVER_SPREAD
from recorders.cdr.codec import decode_as
from recorders.errors import ConfigError, LogError
from recorders.messages.message_types import PoseStamped
from recorders.messages.topics import JOINT_COMMANDS, SAMPLE_JOINTS, commanded_tick
from recorders.reading.reader import LogReader
from recorders.text.wording import value_text
from recorders.ticks.joiner import Tick, join_ticks
from replay.diff.fields import format_pair
from replay.sources.scheduled import naming


@dataclass(frozen=True, eq=False)
class _Settings:
    """Settings of an exploration, as its log has them."""

    leader: Leader
    simulation: SimulationConfig
    config: ExplorationConfig
    seed: int
    closed: bool


def simulate(log: Path, *, ticks: int) -> Iterator[TopicMessage]:
    """Yield targets, joints and hands of the first ticks of an exploration, simulated again.

    The robot is the one of that name that comes with the program, so that a change to it shows, else the log's. Where
    that of the log had no resolution, it has none here either.

    Parameters
    ----------
    log : Path
        Written by `explore`; its targets, seed and parameters are taken over.
    ticks : int
        At most this many ticks are made; what the robot does to settle before the first comes on top.

    Raises
    ------
    LogError
        If the log is not one of an exploration, or cannot be read.
    ReenactError
        If its parameters are not usable.
    """
    settings = _exploration(log)
    robot = _present(log)
    motion_plan = _plan(log, settings, robot, ticks=ticks)
    backend = Simulation(robot, settings.simulation)
    start = start_posture(robot, seed=settings.seed, spread=settings.config.start_spread)
    guide = make_guide(robot, settings.leader, seed=settings.seed)
    noise = settings.config.noise(robot, seed=settings.seed, period_ns=guide.period_ns)
    episode = GuidedRun(backend, guide, start=start, noise=noise)
    episode.settle_placed(motion_plan, backend, driven_ns=settings.config.settle_ns)
    for topic, message in episode.cycle(motion_plan):
        if topic != JOINT_COMMANDS:
            yield topic, message
        if topic == SAMPLE_JOINTS:
            yield from hand_messages(backend)


def leader_spread(manifest: Mapping[str, Any]) -> float:
    """Return how far apart a log with this manifest, and the same made on another machine, may be [rad or m]."""
    return SOLVER_SPREAD if "qp_teacher" in manifest else 0.0


def changed_robot(log: Path) -> str:
    """Return the line in which the robot that comes with the program differs from the log's; empty if none does."""
    logged, present = _logged(log), _present(log)
    for name in ("robot.toml", "robot.urdf"):
        field = f"{name.removeprefix('robot.')}_text"
        lines = zip(getattr(logged, field).split("\n"), getattr(present, field).split("\n"), strict=False)
        for number, (old, new) in enumerate(lines, 1):
            if old != new:
                expected, found = format_pair(old.strip(), new.strip())
                return f"{name} line {number} is {expected} in the log, {found} now"
    return ""


def _present(log: Path) -> RobotConfig:
    name, logged = LogReader(log).manifest.get("robot"), _logged(log)
    present = load_robot(name) if isinstance(name, str) and name in robot_names() else logged
    return present if logged.resolution != UNLIMITED else replace(present, resolution=UNLIMITED)


def _logged(log: Path) -> RobotConfig:
    return require_recorded_robot(LogReader(log))


def _exploration(log: Path) -> _Settings:
    manifest = LogReader(log).manifest
    if manifest.get("kind") != "exploration":
        raise LogError(f"{log}: expected a log of explore, found one of kind {value_text(manifest.get('kind'))}")
    try:
        return _Settings(
            leader=leader_of(manifest),
            simulation=SimulationConfig(**manifest["simulation"]),
            config=ExplorationConfig(**manifest["exploration"]),
            seed=_whole(manifest["seed"]),
            closed=bool(manifest["motion"]["closed"]),
        )
    except (KeyError, TypeError) as error:
        raise LogError(f"{log}: the manifest does not hold the settings of the exploration: {error}") from error


def _whole(value: Any) -> int:
    if type(value) is not int or value < 0:
        raise ConfigError(f"seed: expected a whole number from 0 up, found {str(value)[:40]}")
    return value


def _plan(log: Path, settings: _Settings, robot: RobotConfig, *, ticks: int) -> MotionPlan:
    """Hold each logged target until the next tick, as the exploration did."""
    topics = commanded_tick(robot.hand_names)
    with naming(log):
        logged = [(tick.stamp_ns, _rows(tick, robot)) for tick in join_ticks(LogReader(log), topics=topics)]
    if len(logged) < 2:
        raise LogError(f"{log}: expected at least two complete ticks, found {len(logged)}")
    holds = [TargetHold(target, after - stamp) for (stamp, target), (after, _) in pairwise(logged)]
    settling = holds if settings.closed else [TargetHold(logged[0][1], settings.config.settle_ns)]
    first = holds[: ticks - 1]  # and the tick after the last of them
    return MotionPlan(settling, first, logged[len(first)][1])


def _rows(tick: Tick, robot: RobotConfig) -> Floats:
    """Return the targets of a tick by row."""
    poses = (decode_as(PoseStamped, record.data) for record in tick.records if record.type == PoseStamped.TYPE)
    return np.array([[*pose.position, *pose.orientation][: row_size(robot)] for pose in poses])
