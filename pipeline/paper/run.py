"""The whole of the paper, rerun from seeds: exploration, ten trainings of each pattern, every test, deployment."""

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field
from pathlib import Path

from pipeline.deployment.deploy import deploy
from pipeline.evaluation.trials import robot_of
from pipeline.exploration.explore import explore
from pipeline.learner.rules.reservoir.config import LearnerConfig
from pipeline.motions import names as motion_names
from pipeline.motions.motion import load_motion
from pipeline.motions.names import PATTERNS
from pipeline.paper.command_costs import command_costs
from pipeline.paper.comparison.run import FOLDER, TEACHERS_FOLDER, ComparisonConfig, compare
from pipeline.paper.networks import try_networks
from pipeline.paper.results import CONTROLLERS, PATTERN_1, PATTERN_2, REPORT, SUMMARY, NetworkEnsemble, PaperResults
from pipeline.robot.config import load_robot
from pipeline.samples.pairs import read_samples
from pipeline.simulation.simulation import SimulationConfig
from pipeline.teacher.teacher import TeacherConfig
from pipeline.terminal import console
from pipeline.training.batch import Executors, Outcome, Run, RunsError, as_completed, compute, compute_all
from pipeline.training.executors import local_processes
from recorders.errors import CheckFailed, ConfigError
from recorders.files.anonymous_file import write_json
from recorders.writing.part_file import part_of
from replay.sources.schedule import Schedule

ROBOT = "asimo"
_PATTERN_PERIOD_NS = 200_000_000  # the paper's 5 Hz
_COARSE_NS = 20_000_000  # period of teacher and simulation in a short run


@dataclass(frozen=True)
class PaperConfig:
    """Extent of a rerun of the paper.

    Attributes
    ----------
    seed : int
        Seed of the explorations, and of the first initialisation; the others follow it.
    initialisations : int
        How many networks learn each pattern.
    epochs : tuple of int
        Epochs of pattern 1 and of pattern 2.
    teacher : TeacherConfig
        How the teacher moves while it explores.
    simulation : SimulationConfig
        How the robot is simulated while it explores.
    comparison : ComparisonConfig
        How learning rules are compared.
    compared : int
        Over how many seeds of exploration, from `seed` on.
    is_full : bool
        Whether the run is one whose numbers count, so that the bounds are checked.
    """

    seed: int = 0
    initialisations: int = 10
    epochs: tuple[int, int] = (150, 600)
    teacher: TeacherConfig = field(default_factory=TeacherConfig)
    simulation: SimulationConfig = field(default_factory=SimulationConfig)
    comparison: ComparisonConfig = field(default_factory=ComparisonConfig)
    compared: int = 1
    is_full: bool = True

    def __post_init__(self) -> None:
        """Check the ranges."""
        if self.seed < 0 or min(self.initialisations, self.compared, *self.epochs) < 1:
            raise ConfigError("paper: expected a seed of at least 0, one initialisation and one epoch of each pattern")

    @classmethod
    def quick(cls, *, seed: int = 0, compared: int = 1) -> "PaperConfig":
        """Return a run of seconds that goes through everything; its numbers have no meaning."""
        teacher = TeacherConfig(period_ns=_COARSE_NS)
        simulation = SimulationConfig(step_ns=_COARSE_NS, control_ns=_COARSE_NS)
        return cls(
            seed=seed,
            initialisations=2,
            epochs=(3, 12),
            teacher=teacher,
            simulation=simulation,
            comparison=ComparisonConfig.quick(step_ns=_COARSE_NS),
            compared=compared,
            is_full=False,
        )

    @property
    def seeds(self) -> tuple[int, ...]:
        """Seed of each initialisation."""
        return tuple(range(self.seed, self.seed + self.initialisations))


def drawings() -> tuple[str, ...]:
    """Names of the free-hand motions that come with the program."""
    return tuple(motion_names.drawings())


def run_paper(out: Path, *, config: PaperConfig, executors: Executors = local_processes) -> PaperResults:
    """Rerun the paper in the folder `out`, replacing what an earlier run left there.

    Parameters
    ----------
    out : Path
        Folder for logs, controllers and summary.
    config : PaperConfig
        How much of it.
    executors : callable
        Opens what the initialisations are computed on.

    Raises
    ------
    ReenactError
        If a stage fails.
    """
    logs = {name: out / f"{name}.mcap" for name in (*PATTERNS, *drawings())}
    _make_folders(out, logs.values())
    with executors():
        pass  # a cluster that does not answer is better known now than after the exploration
    first, seconds = _explore_and_learn_once(logs[PATTERN_1], config)
    _explore_all({name: log for name, log in logs.items() if name != PATTERN_1}, config)
    with console.progress("learn from other starts") as advance:
        runs = _runs(logs, config)[1:]
        others = compute_all(runs, executors, on_done=lambda done: advance(done / len(runs)))
    with console.progress("test every network"):
        networks = _tested([first, *others], logs, config)
        _save_controllers(out / CONTROLLERS, networks)
    one = networks[PATTERN_1]
    controller, trial = one.controllers[0], one.trials[PATTERN_1][0]
    robot = robot_of(controller)
    with console.progress("deploy") as advance:
        deployed = deploy(controller, load_motion(PATTERN_2, robot), progress=advance)
    costs = command_costs(controller, trial, period_ns=_PATTERN_PERIOD_NS)
    seeds = range(config.seed, config.seed + config.compared)
    learned = networks[PATTERN_1].controllers
    compared = compare(out, learned, logs[PATTERN_1], seeds=seeds, config=config.comparison)
    paper = PaperResults(config.seed, robot, networks, drawings(), deployed, costs, seconds, compared)
    write_json(out / SUMMARY, paper.summary())
    return paper


def check_bounds(paper: PaperResults) -> None:
    """Check every bound of the paper's rerun.

    Raises
    ------
    CheckFailed
        If one does not hold; the line names all that do not.
    """
    if failed := [f"{check.claim}, found {check.found}" for check in paper.checks() if not check.holds]:
        raise CheckFailed(f"the paper is not reproduced: expected {'; expected '.join(failed)}")


def _explore_and_learn_once(log: Path, config: PaperConfig) -> tuple[Outcome, float]:
    """Explore pattern 1 and learn it once, with nothing beside it; return the outcome, and how long it took [s]."""
    began_s = time.monotonic()
    with console.progress("explore") as advance:
        _explore(PATTERN_1, log, config, advance)
    with console.progress("learn once"):
        first = compute(_runs({PATTERN_1: log}, config)[0])
    return first, round(time.monotonic() - began_s, 2)


def _explore_all(logs: Mapping[str, Path], config: PaperConfig) -> None:
    """Explore several motions side by side, in processes of this machine."""
    try:
        with console.progress("explore the other motions") as advance, local_processes() as pool:
            explored = [pool.submit(_explore, name, log, config) for name, log in logs.items()]
            for done, future in enumerate(as_completed(explored), 1):
                future.result()
                advance(done / len(explored))
    except BrokenProcessPool as error:
        raise RunsError("a process that explores was killed: is there enough memory?") from error


def _explore(
    name: str, log: Path, config: PaperConfig, progress: Callable[[float], None] = lambda fraction: None
) -> None:
    robot = load_robot(ROBOT)
    explore(
        robot,
        load_motion(name, robot),
        seed=config.seed,
        out=log,
        teacher=config.teacher,
        simulation=config.simulation,
        overwrite=True,
        progress=progress,
    )


def _runs(logs: Mapping[str, Path], config: PaperConfig) -> list[Run]:
    """Return the trainings on the patterns among the logs: pattern 1 from every initialisation, then pattern 2."""
    return [
        Run((logs[pattern].resolve(),), Schedule(epochs=epochs), LearnerConfig(seed=seed))
        for pattern, epochs in zip(PATTERNS, config.epochs, strict=True)
        for seed in config.seeds
        if pattern in logs
    ]


def _tested(outcomes: Sequence[Outcome], logs: Mapping[str, Path], config: PaperConfig) -> dict[str, NetworkEnsemble]:
    """Try all networks on all motions; by the pattern that they learned."""
    samples = {name: read_samples(log) for name, log in logs.items()}
    half = config.initialisations
    return {
        pattern: try_networks(pattern, learned, seeds=config.seeds, samples=samples)
        for pattern, learned in ((PATTERN_1, outcomes[:half]), (PATTERN_2, outcomes[half:]))
    }


def _make_folders(out: Path, logs: Iterable[Path]) -> None:
    """Make the folders, and take away what an earlier run left that a failed one would leave standing."""
    try:
        (out / CONTROLLERS).mkdir(parents=True, exist_ok=True)
        stale = [out / SUMMARY, out / REPORT, *out.glob("figure[456]*.png")]
        stale += [path for pattern in PATTERNS for path in (out / CONTROLLERS).glob(f"{pattern}-*.npz")]
        stale += [part for folder in (FOLDER, TEACHERS_FOLDER) for part in (out / folder).glob("*.part")]
        stale += [part_of(log) for log in logs]
        for path in stale:
            path.unlink(missing_ok=True)
    except OSError as error:
        raise ConfigError(f"{out}: expected a folder to write to: {error.strerror}") from error


def _save_controllers(folder: Path, networks: Mapping[str, NetworkEnsemble]) -> None:
    for learned in networks.values():
        for seed, controller in zip(learned.seeds, learned.controllers, strict=True):
            controller.save(folder / f"{learned.pattern}-{seed}.npz")
