"""Explorations that a rule learns from: with a teacher and without one, long and short, on our robot and on others."""

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from pipeline.evaluation.errors import HandErrors
from pipeline.evaluation.trials import evaluate_motion
from pipeline.exploration.explore import explore
from pipeline.exploration.source import Source, self_exploration, source
from pipeline.exploration.via_points import VOLUME
from pipeline.learner.registry import default_config
from pipeline.motions.names import PATTERNS, drawings
from pipeline.robot.config import load_robot
from pipeline.simulation.simulation import SimulationConfig
from pipeline.training.trainer import train
from recorders.errors import MotionError, RobotError

RULE = "forward-inverse"
_SIMULATION = SimulationConfig()


@dataclass(frozen=True)
class Exploration:
    """One way to explore.

    Attributes
    ----------
    name, title : str
        Its key in results and file names, and what to call it.
    duration_s : float
        Length [s].
    tick_rate_hz : int
        Ticks in a second.
    patterns_cm, drawings_cm : float
        Bounds of the error [cm] on the paper's patterns, and on each hand of each drawing.
    is_taught : bool
        Whether the teacher leads; else the learner.
    robot : str
        The robot's name.
    motions : tuple of str
        Motions on which what was learned is tried.
    """

    name: str
    title: str
    duration_s: float
    tick_rate_hz: int
    patterns_cm: float
    drawings_cm: float
    is_taught: bool = True
    robot: str = "asimo"
    motions: tuple[str, ...] = (*PATTERNS, *drawings())

    def source(self) -> Source:
        """Return the source of the exploration."""
        if self.is_taught:
            return source(VOLUME, duration_s=self.duration_s, tick_rate_hz=self.tick_rate_hz)
        return self_exploration(duration_s=self.duration_s, tick_rate_hz=self.tick_rate_hz)

    @property
    def commands(self) -> tuple[str, str, str]:
        """Commands that explore so, learn and try, with SEED and MOTION for these."""
        way = f"--motion {VOLUME}" if self.is_taught else "--no-teacher"
        pace = f"--duration {self.duration_s:g} --tick-rate {self.tick_rate_hz}"
        again = f"again-{self.name}-SEED"
        return (
            f"reenact explore {way} {pace} --robot {self.robot} --seed SEED --out {again}.mcap",
            f"reenact train {again}.mcap --rule {RULE} --out {again}.npz",
            f"reenact evaluate {again}.npz MOTION",
        )


TAUGHT = Exploration("taught_120s", "120 s at 5 Hz, with a teacher", 120.0, 5, 0.04, 0.08)
EXPLORATIONS = (
    TAUGHT,
    Exploration("taught_30s", "30 s at 50 Hz, with a teacher", 30.0, 50, 0.12, 0.12),
    Exploration("self_taught_120s", "120 s at 25 Hz, without a teacher", 120.0, 25, 0.08, 0.08, is_taught=False),
    Exploration("self_taught_30s", "30 s at 25 Hz, without a teacher", 30.0, 25, 0.20, 0.20, is_taught=False),
)
OTHER_ROBOTS = tuple(
    replace(TAUGHT, name=name, title=f"{title}: 120 s at 5 Hz", robot=name, motions=PATTERNS[:1], patterns_cm=0.10)
    for name, title in (("icub", "iCub"), ("g1", "G1"), ("talos", "TALOS"))
)
"""Their models come with the extra `robots`."""


@dataclass(frozen=True)
class Explored:
    """Result of learning from one exploration.

    Attributes
    ----------
    exploration : Exploration
        How it was explored.
    seed : int
        Its seed.
    log : Path
        Its log.
    errors : mapping of str to HandErrors
        By motion, what was learned tried on it; empty if the exploration was refused.
    seconds : float
        Time to explore and to learn [s].
    refused : str
        Why the exploration was refused, in one line; empty if it was not.
    """

    exploration: Exploration
    seed: int
    log: Path
    errors: Mapping[str, HandErrors]
    seconds: float
    refused: str = ""


def explore_and_learn(exploration: Exploration, *, seed: int, folder: Path, step_ns: int | None = None) -> Explored:
    """Explore to a log in a folder, learn from it in one pass, and try what was learned.

    Parameters
    ----------
    exploration : Exploration
        How to explore.
    seed : int
        Seed of the exploration.
    folder : Path
        Where the log goes, over one that is there.
    step_ns : int, optional
        Period of teacher and simulation [ns] of a coarse run; their own if left out.

    Raises
    ------
    ReenactError
        If a stage fails; a motion or a robot that is refused is a result.
    """
    began_s = time.monotonic()
    log = folder / f"{exploration.name}-{seed}.mcap"
    try:
        _simulate(exploration.source(), exploration.robot, seed, log, step_ns)
    except (MotionError, RobotError) as error:
        return Explored(exploration, seed, log, {}, round(time.monotonic() - began_s, 2), refused=str(error))
    settings = default_config(RULE)
    controller = train([log], schedule=settings.schedule(), config=settings).controller()
    seconds = round(time.monotonic() - began_s, 2)
    errors = {name: evaluate_motion(controller, name).errors for name in exploration.motions}
    return Explored(exploration, seed, log, errors, seconds)


def with_step(way: Source, step_ns: int | None) -> tuple[Source, SimulationConfig]:
    """Return a source with its teacher's period [ns], and the simulation that goes with it; their own if None."""
    if step_ns is None:
        return way, _SIMULATION
    qp = way.qp and replace(way.qp, period_ns=step_ns)
    way = replace(way, teacher=replace(way.teacher, period_ns=step_ns), qp=qp)
    return way, SimulationConfig(step_ns=step_ns, control_ns=step_ns)


def _simulate(way: Source, robot_name: str, seed: int, log: Path, step_ns: int | None) -> None:
    way, simulation = with_step(way, step_ns)
    robot = load_robot(robot_name)
    guidance = way.guidance(robot, seed=seed)
    if step_ns is not None:
        guidance = replace(guidance, keep_clear=False)  # a coarse robot lags more than was planned for
    explore(
        robot,
        way.motion(robot, seed=seed),
        seed=seed,
        out=log,
        simulation=simulation,
        config=way.config,
        guidance=guidance,
        overwrite=True,
    )
