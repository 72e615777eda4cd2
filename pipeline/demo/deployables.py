"""Two controllers to deploy, of the rule forward-inverse: one taught, and one that explored without a teacher."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from rich.table import Table

from pipeline.demo.beside import beside, learn_over_zenoh
from pipeline.demo.trials import Trials, try_motions
from pipeline.learner.controller import Controller
from pipeline.learner.registry import default_config
from pipeline.robot.config import RobotConfig
from pipeline.training.pairing_choice import pairing_of
from pipeline.training.trainer import train
from recorders.errors import CheckFailed
from recorders.text.quantities import decimal_text

RULE = "forward-inverse"
DURATION_S = 120.0
"""Of each exploration, in the robot's time [s]."""

TAUGHT, SELF_TAUGHT = CONTROLLERS = ("deployable.npz", "self_taught.npz")
TAUGHT_LOG, SELF_TAUGHT_LOG = LOGS = ("volume.mcap", "self_explored.mcap")


@dataclass(frozen=True, eq=False)
class Deployable:
    """A controller to deploy, and how it does on the demo's motions, none of which it was trained on.

    Attributes
    ----------
    controller, log : Path
        Its file, and the exploration that it learned from.
    live_digest, file_digest : str
        State digests of the learner that learned live, over Zenoh or while it explored, and of that trained from the
        log.
    trials : (Trial, Trial, Trial)
        Pattern 1, pattern 2 and the drawing, in this order.
    """

    controller: Path
    log: Path
    live_digest: str
    file_digest: str
    trials: Trials

    def errors_cm(self) -> dict[str, float]:
        """Return the mean distances from the targets [cm]: of both hands on the patterns, of each on the drawing."""
        first, second, drawing = self.trials
        patterns = {trial.name: trial.errors.mean_cm for trial in (first, second)}
        return patterns | {f"drawing_{hand}": error_cm for hand, error_cm in drawing.errors.hands_cm.items()}

    def check(self) -> None:
        """Check that learning live and from the log came to one state; raises CheckFailed."""
        if self.live_digest != self.file_digest:
            raise CheckFailed(
                f"{self.controller.name}: expected one state, found {self.live_digest[:16]} learned live and "
                f"{self.file_digest[:16]} from {self.log.name}"
            )


@contextmanager
def explorations(
    out: Path, *, robot: str, seed: int, duration_s: float
) -> Iterator[tuple[Callable[[], object], Callable[[], str]]]:
    """Explore in two processes while the block runs: with the teacher, and by the learner itself.

    Yields
    ------
    (callable, callable)
        The first waits for the taught exploration; the second for the other, and returns its learner's digest.
    """
    options = ("--robot", robot, "--seed", seed, "--duration", duration_s, "--overwrite", "--out")
    folder = out.resolve()
    with (
        beside("explore", "--motion", "volume", *options, folder / TAUGHT_LOG) as taught,
        beside("explore", "--no-teacher", *options, folder / SELF_TAUGHT_LOG) as self_taught,
    ):
        yield taught, lambda: str(self_taught()["digest"])


def learn_taught(out: Path, patterns: list[Path], *, robot: RobotConfig, seed: int) -> Deployable:
    """Learn the taught exploration in `out` over Zenoh and from the file, and try what was learned over Zenoh."""
    config = default_config(RULE, seed=seed)
    schedule = config.schedule(topics=pairing_of(config).topics(robot.hand_names))
    log, controller = out / TAUGHT_LOG, out / TAUGHT
    live_digest = learn_over_zenoh(log, controller, seed=seed, schedule=schedule, options=("--rule", RULE))
    file_digest = str(train([log], schedule=config.schedule(), config=config).result()["digest"])
    return Deployable(controller, log, live_digest, file_digest, try_motions(Controller.load(controller), patterns))


def learn_self_taught(out: Path, patterns: list[Path], *, seed: int, live_digest: str) -> Deployable:
    """Train from what a learner in `out` explored by itself, whose digest is given, and try the controller."""
    config = default_config(RULE, seed=seed)
    log, path = out / SELF_TAUGHT_LOG, out / SELF_TAUGHT
    trainer = train([log], schedule=config.schedule(), config=config)
    controller = trainer.controller()
    controller.save(path)
    return Deployable(path, log, live_digest, str(trainer.result()["digest"]), try_motions(controller, patterns))


def deployables_table(taught: Deployable, self_taught: Deployable) -> Table:
    """Return the errors of both controllers, for the terminal."""
    title = f"The rule to deploy, {RULE}: learned from random points in one pass, trained on none of these; in cm"
    table = Table(title=title, title_justify="left")
    table.add_column("motion")
    for heading in ("taught", "left", "right", "worst", "without teacher", "left", "right", "worst"):
        table.add_column(heading, justify="right")
    labels = ("circles", "eight", "right-hand drawing (generated)")
    for label, *trials in zip(labels, taught.trials, self_taught.trials, strict=True):
        found = [trial.errors for trial in trials]
        cells = [cm for errors in found for cm in (errors.mean_cm, *errors.hands_cm.values(), errors.max_cm)]
        table.add_row(label, *map(decimal_text, cells))
    return table
