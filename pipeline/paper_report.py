"""The report of the paper's rerun: one HTML page that needs nothing beside it, and its pictures as PNG."""

import base64
from collections.abc import Callable, Iterable, Sequence
from html import escape
from pathlib import Path

from pipeline.command_costs import CommandCost
from pipeline.paper_explanations import Depth, Direction, depths, directions, turning_point
from pipeline.paper_figures import Picture, draw_figures
from pipeline.paper_page import PAGE
from pipeline.paper_results import PATTERN_1, PATTERN_2, REPORT, Networks, Paper
from pipeline.paper_table import Row, rows
from recorders.errors import ConfigError

_COLUMNS = ("quantity", "ours", "the paper", "teacher", "linear", "seeds", "command")
_SHORT_RUN = "<p><strong>This was a short run to try everything out: its numbers say nothing.</strong></p>"


def write_report(
    paper: Paper, out: Path, *, is_full: bool = True, progress: Callable[[float], None] = lambda share: None
) -> Path:
    """Draw all figures, write the page beside them and return its path.

    Parameters
    ----------
    paper : Paper
        What to report.
    out : Path
        Folder to write to.
    is_full : bool
        Whether the bounds count; the page of a short run says that they do not.
    progress : callable
        Told the share of the pictures that are drawn, 0 to 1.

    Raises
    ------
    ConfigError
        A file cannot be written.
    """
    pictures = draw_figures(paper, out, on_picture=progress)
    page = PAGE.substitute(
        seed=paper.seed,
        checks=_checks(paper) if is_full else _SHORT_RUN,
        table=_table(_COLUMNS, map(_cells, rows(paper))),
        figures4=_figures(pictures, "figure4", out),
        figures5=_figures(pictures, "figure5", out),
        figures6=_figures(pictures, "figure6", out),
        turn4=_turn(paper.networks[PATTERN_1]),
        turn5=_turn(paper.networks[PATTERN_2]),
        depths=_depths(depths(paper, paper.networks[PATTERN_1])),
        directions=_directions(directions(paper)),
        learned_cm=f"{paper.deployed.learned_cm:.2f}",
        teacher_cm=f"{paper.deployed.teacher_cm:.2f}",
        costs=_costs(paper.costs),
    )
    path = out / REPORT
    try:
        path.write_text(page, encoding="utf-8")
    except OSError as error:
        raise ConfigError(f"cannot write the report '{path}': {error.strerror}") from error
    return path


def _checks(paper: Paper) -> str:
    verdicts = {True: "holds", False: '<span class="fails">fails</span>'}
    body = [(escape(check.claim), escape(check.found), verdicts[check.holds]) for check in paper.checks()]
    return _table(("claim", "found", ""), body)


def _cells(row: Row) -> Sequence[str]:
    texts = (row.what, row.ours, row.papers, row.teacher, row.linear, row.seeds)
    return (*map(escape, texts), f"<code>{escape(row.command)}</code>")


def _directions(found: Sequence[Direction]) -> str:
    columns = (
        "direction",
        "spread of pattern 1",
        "spread of pattern 2",
        "error on pattern 1 of networks that learned pattern 1",
        "error on pattern 1 of networks that learned pattern 2",
    )
    body = []
    for part in found:
        values = (part.pattern_1_cm, part.pattern_2_cm, part.missed_cm[PATTERN_1], part.missed_cm[PATTERN_2])
        body.append((escape(part.name), *(f"{value:.2f}" for value in values)))
    return _table(columns, body)


def _depths(found: Sequence[Depth]) -> str:
    columns = ("motion", "hand", "error in the plane (cm)", "error ahead or behind (cm)")
    return _table(
        columns,
        [(escape(part.motion), part.hand, f"{part.in_plane_cm:.2f}", f"{part.off_plane_cm:.2f}") for part in found],
    )


def _turn(networks: Networks) -> str:
    """Return a paragraph on how the error went, if it did not fall to the end."""
    turn = turning_point(networks)
    if turn is None:
        return ""
    epoch, least_cm = turn
    return (
        f"<p>Unlike the paper's, the error does not fall to the end: it was least in epoch {epoch}, {least_cm:.2f} cm. "
        "The networks learn the postures as they were recorded, the teacher's lag included: at the end their hands are "
        f"{networks.from_recorded_cm.mean():.2f} cm from where the recorded hands were, and "
        f"{networks.trained_cm.mean():.2f} cm from the targets.</p>"
    )


def _costs(costs: Iterable[CommandCost]) -> str:
    columns = (
        "controller",
        "error (cm)",
        "time of a step (µs)",
        "steps for a target",
        "time for a target (µs)",
        "iterates",
    )
    body = [
        (
            escape(cost.name),
            f"{cost.mean_cm:.2f}",
            f"{cost.microseconds:.0f}",
            str(cost.steps),
            f"{cost.microseconds * cost.steps:.0f}",
            "yes" if cost.iterates else "no",
        )
        for cost in costs
    ]
    return _table(columns, body)


def _table(columns: Sequence[str], body: Iterable[Sequence[str]]) -> str:
    """Return a table of cells that are HTML already; a cell that begins with a digit does not break."""
    head = "".join(f"<th>{escape(column)}</th>" for column in columns)
    lines = ["".join(f"{_opening(cell)}{cell}</td>" for cell in row) for row in body]
    return f"<table>\n<tr>{head}</tr>\n" + "\n".join(f"<tr>{line}</tr>" for line in lines) + "\n</table>"


def _opening(cell: str) -> str:
    return '<td class="number">' if cell[:1].isdigit() else "<td>"


def _figures(pictures: Iterable[Picture], prefix: str, out: Path) -> str:
    """Return the pictures of a figure, with their bytes within the page."""
    chosen = [picture for picture in pictures if picture.name.startswith(prefix)]
    return "\n".join(_figure(picture, (out / picture.name).read_bytes()) for picture in chosen)


def _figure(picture: Picture, png: bytes) -> str:
    data, says = base64.b64encode(png).decode("ascii"), escape(picture.says)
    caption = f"<figcaption>As the paper's figure {escape(picture.figure)}. {says}</figcaption>"
    return f'<figure><img src="data:image/png;base64,{data}" alt="{says}">{caption}</figure>'
