"""The report's table: our numbers beside the paper's, the teacher's and a linear baseline's, and their source."""

from collections.abc import Iterator
from dataclasses import dataclass

from rich.table import Table

from pipeline.arrays import Floats
from pipeline.demo.run import PAPER_CM
from pipeline.paper.bounds import spread
from pipeline.paper.results import (
    CONTROLLERS,
    PATTERN_1,
    PATTERN_2,
    STILL_BOUND_CM,
    NetworkEnsemble,
    PaperResults,
    drawing_title,
)

NONE = "–"
_FAILS, _ACCURATE = "fails", "accurate"  # where it gives no number


@dataclass(frozen=True)
class Row:
    """A row of the table, as text; errors in cm.

    Attributes
    ----------
    what : str
        The quantity.
    ours, papers, teacher, linear : str
        Its values.
    seeds : str
        Of the networks, or of what else is drawn.
    commands : tuple of str
        That give it, in the folder of the report.
    printed : str
        The name under which they print ours, for each seed.
    """

    what: str
    ours: str
    papers: str
    teacher: str
    linear: str
    seeds: str
    commands: tuple[str, ...]
    printed: str


def rows(paper: PaperResults) -> Iterator[Row]:
    """Yield the table, row by row."""
    one, two = paper.networks[PATTERN_1], paper.networks[PATTERN_2]
    yield _trained(one, "Pattern 1, learned")
    yield _tested(one, PATTERN_2, "Pattern 2, by networks that learned pattern 1", _ACCURATE)
    yield _trained(two, "Pattern 2, learned")
    yield _tested(two, PATTERN_1, "Pattern 1, by networks that learned pattern 2", _FAILS)
    for networks, number in ((one, "1"), (two, "2")):
        for name in paper.demonstrations:
            yield from _demonstrated(networks, name, f"{drawing_title(name)}, pattern {number} learned")
    yield _deployed(paper)
    yield _explored(paper)


def console_table(paper: PaperResults) -> Table:
    """Return the table for the terminal: without commands, which the report has."""
    table = Table(caption="cm, mean ± standard deviation over the networks", caption_justify="left")
    table.add_column("")
    for heading in ("ours", "the paper", "teacher", "linear"):
        table.add_column(heading, justify="right")
    for row in rows(paper):
        table.add_row(row.what, row.ours, row.papers, row.teacher, row.linear)
    return table


def _trained(networks: NetworkEnsemble, what: str) -> Row:
    pattern, epochs = networks.pattern, networks.curves_cm.shape[1]
    again, original = f"again-{pattern}-SEED.npz", _controller(pattern)
    commands = (
        f"reenact train {pattern}.mcap --epochs {epochs} --seed SEED --out {again}",
        f"reenact diff {again} {original}",
        _evaluate(networks, pattern),
    )
    beside = _beside(networks, pattern, "mean_cm")
    papers = _cm(PAPER_CM[pattern])
    return Row(what, _spread(networks.trained_cm), papers, *beside, _seeds(networks), commands, "train_cm")


def _tested(networks: NetworkEnsemble, motion: str, what: str, papers: str, part: str = "mean_cm") -> Row:
    """Return the row of a part of the `HandErrors` on a motion."""
    ours, commands = _spread(networks.errors_cm(motion, part)), (_evaluate(networks, motion),)
    return Row(what, ours, papers, *_beside(networks, motion, part), _seeds(networks), commands, part)


def _demonstrated(networks: NetworkEnsemble, name: str, what: str) -> Iterator[Row]:
    is_first = networks.pattern == PATTERN_1
    still = f"below {STILL_BOUND_CM:g}" if is_first else _FAILS
    yield _tested(networks, name, f"{what}: right hand", _ACCURATE if is_first else _FAILS, "right_cm")
    yield _tested(networks, name, f"{what}: left, held still", still, "left_cm")
    yield _tested(networks, name, f"{what}: left, farthest", still, "left_max_cm")


def _deployed(paper: PaperResults) -> Row:
    deployed, seed = paper.deployed, paper.networks[PATTERN_1].seeds[0]
    what = "Physical hands on pattern 2 at 10 Hz, pattern 1 learned"
    command = f"reenact evaluate {_controller(PATTERN_1, str(seed))} {deployed.motion} --deploy"
    learned_cm, teacher_cm = _cm(deployed.learned_cm), _cm(deployed.teacher_cm)
    return Row(what, learned_cm, _ACCURATE, teacher_cm, NONE, str(seed), (command,), "learned_cm")


def _explored(paper: PaperResults) -> Row:
    seed, epochs = paper.seed, paper.networks[PATTERN_1].curves_cm.shape[1]
    again = f"again-{PATTERN_1}"
    commands = (
        f"reenact explore --motion {PATTERN_1} --seed {seed} --out {again}.mcap --overwrite",
        f"reenact train {again}.mcap --epochs {epochs} --seed {seed} --out {again}.npz",
    )
    what, ours = "Time to explore pattern 1 and to learn it once", f"{paper.seconds_explore_and_learn:.0f} s"
    return Row(what, ours, "< 120 s", NONE, NONE, str(seed), commands, NONE)


def _beside(networks: NetworkEnsemble, motion: str, part: str) -> tuple[str, str]:
    """Return the same part of the teacher's errors and of the baseline's; `evaluate` prints no farthest of theirs."""
    taught = networks.trials[motion][0].teacher
    if part == "left_max_cm":
        return NONE, NONE
    return NONE if taught is None else _cm(taught.to_dict()[part]), _cm(networks.linear[motion].to_dict()[part])


def _evaluate(networks: NetworkEnsemble, motion: str) -> str:
    learned = networks.pattern
    return f"reenact evaluate {_controller(learned)} {motion}.mcap --linear-from {learned}.mcap"


def _controller(pattern: str, seed: str = "SEED") -> str:
    return f"{CONTROLLERS}/{pattern}-{seed}.npz"


def _seeds(networks: NetworkEnsemble) -> str:
    first, last = networks.seeds[0], networks.seeds[-1]
    return str(first) if first == last else f"{first}–{last}"


def _spread(values_cm: Floats) -> str:
    return f"{values_cm.mean():.2f} ± {spread(values_cm):.2f}"


def _cm(value: float) -> str:
    return f"{value:.2f}"
