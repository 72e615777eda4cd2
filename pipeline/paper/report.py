"""The report of the paper's rerun: one HTML page that needs nothing beside it, and its pictures as PNG."""

import base64
from collections.abc import Callable, Iterable, Sequence
from html import escape
from pathlib import Path

from pipeline.paper.command_costs import CommandCost
from pipeline.paper.comparison.page import comparison_texts
from pipeline.paper.error_analysis import APART, Depth, Direction, depths, directions, turning_point
from pipeline.paper.figures import Picture, draw_figures
from pipeline.paper.html_table import table
from pipeline.paper.page_template import PAGE
from pipeline.paper.results import PATTERN_1, PATTERN_2, REPORT, NetworkEnsemble, PaperResults, drawing_title
from pipeline.paper.table import Row, rows
from recorders.errors import ConfigError
from recorders.files.anonymous_file import write_whole

_COLUMNS = ("quantity", "ours", "the paper", "teacher", "linear", "seeds", "commands", "printed as")
_SHORT_RUN = (
    "<p><strong>This was a short run to try everything out: its numbers mean nothing.</strong> It explored coarsely, "
    "so <code>reenact explore</code> gives other logs than those beside this page. All other commands use these logs, "
    "and give the numbers of this page.</p>"
)
_BEYOND = 1.001  # so many times as far out as what was learned: by more than the rounding of targets


def write_report(
    paper: PaperResults, out: Path, *, is_full: bool = True, progress: Callable[[float], None] = lambda share: None
) -> Path:
    """Draw all figures, write the page beside them and return its path.

    Parameters
    ----------
    paper : PaperResults
        What to report.
    out : Path
        Folder to write to.
    is_full : bool
        Whether the bounds count; the page of a short run states that they do not.
    progress : callable
        Called with the share of the pictures that are drawn, 0 to 1.

    Raises
    ------
    ConfigError
        A file cannot be written.
    """
    pictures = draw_figures(paper, out, on_picture=progress)
    far, ways = depths(paper, paper.networks[PATTERN_1]), directions(paper)
    page = PAGE.substitute(
        seed=paper.seed,
        checks=_checks(paper) if is_full else _SHORT_RUN,
        table=table(_COLUMNS, map(_cells, rows(paper))),
        **comparison_texts(paper.comparison),
        figures4=_figures(pictures, "figure4", out),
        figures5=_figures(pictures, "figure5", out),
        figures6=_figures(pictures, "figure6", out),
        turn4=_turn(paper.networks[PATTERN_1]),
        turn5=_turn(paper.networks[PATTERN_2]),
        beyond=_beyond(far, paper),
        depths=_depths(far, paper),
        directions=_directions(ways),
        **_failure(paper, next(way for way in ways if way.name == APART)),
        learned_cm=f"{paper.deployed.learned_cm:.2f}",
        teacher_cm=f"{paper.deployed.teacher_cm:.2f}",
        costs=_costs(paper.costs),
    )
    path = out / REPORT
    try:
        write_whole(path, page.encode())
    except OSError as error:
        raise ConfigError(f"cannot write the report '{path}': {error.strerror}") from error
    return path


def _checks(paper: PaperResults) -> str:
    verdicts = {True: "holds", False: '<span class="fails">fails</span>'}
    body = [
        (escape(check.claim), escape(check.found), verdicts[check.holds])
        for check in (*paper.checks(), *paper.comparison.checks())
    ]
    return table(("claim", "found", ""), body)


def _cells(row: Row) -> Sequence[str]:
    texts = (row.what, row.ours, row.papers, row.teacher, row.linear, row.seeds)
    commands = "".join(f"<code>{escape(command)}</code>" for command in row.commands)
    return (*map(escape, texts), commands, escape(row.printed))


def _failure(paper: PaperResults, apart: Direction) -> dict[str, str]:
    """Return the numbers that show why networks of pattern 2 fail on pattern 1."""
    two = paper.networks[PATTERN_2]
    numbers = {
        "asked_cm": apart.pattern_1_cm,
        "followed": apart.followed[PATTERN_2],
        "missed_cm": apart.missed_cm[PATTERN_2],
        "linear_cm": two.linear[PATTERN_1].mean_cm,
        "networks_cm": float(two.errors_cm(PATTERN_1).mean()),
    }
    return {name: f"{value:.2f}" for name, value in numbers.items()}


def _directions(found: Sequence[Direction]) -> str:
    columns = (
        "direction",
        "spread of pattern 1 (cm)",
        "spread of pattern 2 (cm)",
        "error on pattern 1 of networks that learned pattern 1 (cm)",
        "error on pattern 1 of networks that learned pattern 2 (cm)",
        "part of pattern 1 that the former follow",
        "part that the latter follow",
    )
    body = []
    for part in found:
        answers = [by[pattern] for by in (part.missed_cm, part.followed) for pattern in (PATTERN_1, PATTERN_2)]
        values = (part.pattern_1_cm, part.pattern_2_cm, *answers)
        body.append((escape(part.name), *(f"{value:.2f}" for value in values)))
    return table(columns, body)


def _beyond(found: Sequence[Depth], paper: PaperResults) -> str:
    """Return a paragraph on the drawings that lead a hand farther out than what was learned."""
    learned_cm = max(part.out_cm for part in found if part.motion == PATTERN_1)
    sentences = [
        f"in {escape(drawing_title(part.motion))}, up to {part.out_cm:.1f} cm out, the {part.hand} hand misses by "
        f"{part.missed_cm:.2f} cm: {part.off_plane_cm:.2f} cm ahead or behind, {part.in_plane_cm:.2f} cm in the plane"
        for part in found
        if part.motion in paper.demonstrations and part.out_cm > _BEYOND * learned_cm
    ]
    if not sentences:
        return ""
    return (
        f"<p>Nothing that the networks learned from is farther than {learned_cm:.1f} cm from the centre of a pattern. "
        f"Drawings go beyond it, where networks extrapolate: {'; '.join(sentences)}. The pictures show the last of "
        "these numbers alone: what lies on its targets there is ahead of them or behind by the number before.</p>"
    )


def _depths(found: Sequence[Depth], paper: PaperResults) -> str:
    columns = ("motion", "hand", "farthest target from the centre", "error", "in the plane", "ahead or behind")
    body = []
    for part in found:
        motion = drawing_title(part.motion) if part.motion in paper.demonstrations else part.motion
        values = (part.out_cm, part.missed_cm, part.in_plane_cm, part.off_plane_cm)
        body.append((escape(motion), part.hand, *(f"{value:.2f}" for value in values)))
    return table(columns, body)


def _turn(networks: NetworkEnsemble) -> str:
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
            "yes" if cost.steps > 1 else "no",
        )
        for cost in costs
    ]
    return table(columns, body)


def _figures(pictures: Iterable[Picture], prefix: str, out: Path) -> str:
    """Return the pictures of a figure, with their bytes within the page."""
    chosen = [picture for picture in pictures if picture.name.startswith(prefix)]
    return "\n".join(_figure(picture, (out / picture.name).read_bytes()) for picture in chosen)


def _figure(picture: Picture, png: bytes) -> str:
    data, text = base64.b64encode(png).decode("ascii"), escape(f"{picture.caption} {' '.join(picture.key.split())}")
    caption = f"<figcaption>As the paper's figure {escape(picture.figure)}. {text}</figcaption>"
    return f'<figure><img src="data:image/png;base64,{data}" alt="{text}">{caption}</figure>'
