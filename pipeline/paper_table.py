"""The report's table: our numbers beside the paper's, the teacher's and a linear baseline's, and their source."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from rich.table import Table

from pipeline.demo import PAPER_CM
from pipeline.evaluation import HandErrors
from pipeline.paper_results import PATTERN_1, PATTERN_2, STILL_BOUND_CM, Networks, Paper, spread
from pipeline.trials import Trial

Floats = NDArray[np.float64]

NONE = "–"
_FAILS, _ACCURATE = "fails", "accurate"  # where it gives no number
_Part = Callable[[HandErrors], float]


@dataclass(frozen=True)
class Row:
    """A row of the table, as text; errors in cm.

    Attributes
    ----------
    what : the quantity
    ours, papers, teacher, linear : its values
    seeds : of the networks, or of what else is drawn
    command : that gives it, in the folder of the report
    """

    what: str
    ours: str
    papers: str
    teacher: str
    linear: str
    seeds: str
    command: str


def rows(paper: Paper) -> Iterator[Row]:
    """Yield the table, row by row."""
    one, two = paper.networks[PATTERN_1], paper.networks[PATTERN_2]
    yield _trained(one, "Pattern 1, learned")
    yield _tested(one, PATTERN_2, "Pattern 2, by networks that learned pattern 1", _ACCURATE)
    yield _trained(two, "Pattern 2, learned")
    yield _tested(two, PATTERN_1, "Pattern 1, by networks that learned pattern 2", _FAILS)
    for networks, number in ((one, "1"), (two, "2")):
        for name in paper.demonstrations:
            yield from _demonstrated(networks, name, f"{name.replace('_', ' ')}, pattern {number} learned")
    yield _deployed(paper)
    yield _explored(paper)


def console_table(paper: Paper) -> Table:
    """Return the table for the terminal: without commands, which the report has."""
    table = Table(caption="cm, mean ± standard deviation over the networks", caption_justify="left")
    table.add_column("")
    for heading in ("ours", "the paper", "teacher", "linear"):
        table.add_column(heading, justify="right")
    for row in rows(paper):
        table.add_row(row.what, row.ours, row.papers, row.teacher, row.linear)
    return table


def _deployed(paper: Paper) -> Row:
    deployed, seed = paper.deployed, paper.networks[PATTERN_1].seeds[0]
    what = "Physical hands on pattern 2 at 10 Hz, pattern 1 learned"
    serve = f"reenact serve controllers/{PATTERN_1}-{seed}.npz, and reenact robot"
    return Row(what, _cm(deployed.learned_cm), _ACCURATE, _cm(deployed.teacher_cm), NONE, str(seed), serve)


def _explored(paper: Paper) -> Row:
    ours, command = f"{paper.seconds_explore_and_learn:.0f} s", _explore_command(PATTERN_1, paper.seed)
    what = "Time to explore pattern 1 and to learn it once"
    return Row(what, ours, "less than 120 s", NONE, NONE, str(paper.seed), f"{command}, then train as above")


def _trained(networks: Networks, what: str) -> Row:
    pattern, epochs = networks.pattern, networks.curves_cm.shape[1]
    command = f"reenact train {pattern}.mcap --epochs {epochs} --seed SEED --out controllers/{pattern}-SEED.npz"
    papers = _cm(PAPER_CM[pattern])
    return _row(networks, pattern, what, networks.trained_cm, papers, lambda errors: errors.mean_cm, command)


def _tested(networks: Networks, motion: str, what: str, papers: str) -> Row:
    errors_cm, command = networks.errors_cm(motion), _evaluate_command(networks, motion)
    return _row(networks, motion, what, errors_cm, papers, lambda errors: errors.mean_cm, command)


def _demonstrated(networks: Networks, name: str, what: str) -> Iterator[Row]:
    command, is_first = _evaluate_command(networks, name), networks.pattern == PATTERN_1
    papers = _ACCURATE if is_first else _FAILS
    right_cm, left_cm = networks.errors_cm(name, "right_cm"), networks.errors_cm(name, "left_cm")
    yield _row(networks, name, f"{what}: right hand", right_cm, papers, lambda errors: errors.right_cm, command)
    papers = f"below {STILL_BOUND_CM:g}" if is_first else _FAILS
    yield _row(
        networks, name, f"{what}: left hand, held still", left_cm, papers, lambda errors: errors.left_cm, command
    )
    farthest_cm = np.array([_left_farthest_cm(trial) for trial in networks.trials[name]])
    yield Row(f"{what}: left hand at its farthest", _spread(farthest_cm), papers, NONE, NONE, _seeds(networks), command)


def _left_farthest_cm(trial: Trial) -> float:
    return 100.0 * float(np.linalg.norm(trial.reached[:, 0] - trial.targets[:, :3], axis=1).max())


def _row(networks: Networks, motion: str, what: str, errors_cm: Floats, papers: str, part: _Part, command: str) -> Row:
    taught = networks.trials[motion][0].teacher
    teacher = NONE if taught is None else _cm(part(taught))
    return Row(what, _spread(errors_cm), papers, teacher, _cm(part(networks.linear[motion])), _seeds(networks), command)


def _explore_command(name: str, seed: int) -> str:
    return f"reenact explore --motion {name} --seed {seed} --out {name}.mcap"


def _evaluate_command(networks: Networks, motion: str) -> str:
    return f"reenact evaluate controllers/{networks.pattern}-SEED.npz {motion}.mcap"


def _seeds(networks: Networks) -> str:
    first, last = networks.seeds[0], networks.seeds[-1]
    return str(first) if first == last else f"{first}–{last}"


def _spread(values_cm: Floats) -> str:
    return f"{values_cm.mean():.2f} ± {spread(values_cm):.2f}"


def _cm(value: float) -> str:
    return f"{value:.2f}"
