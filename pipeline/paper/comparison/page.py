"""Texts of the comparison in the report: results of each exploration, all rules side by side, parts of the error."""

from collections.abc import Iterable, Mapping
from html import escape

from pipeline.evaluation.errors import HandErrors
from pipeline.motions.names import PATTERNS
from pipeline.paper.comparison.error_parts import HOLD, ErrorPart
from pipeline.paper.comparison.explorations import Exploration, Explored
from pipeline.paper.comparison.results import Comparison, Figure, drawings_figure, figures_of
from pipeline.paper.comparison.rules import NOT_COMPARED, OUR_RULE, PAPERS_RULE
from pipeline.paper.comparison.teachers import TeacherTrial
from pipeline.paper.html_table import table

_NONE = "–"
_FAILS = '<span class="fails">fails</span>'
_MISSING_ROBOT = "not compared: install robots"
_SUMMARY_COLUMNS = (*PATTERNS, "drawings: left hand", "drawings: right hand")


def comparison_texts(comparison: Comparison) -> dict[str, str]:
    """Return the tables and sentences of the comparison, by their names in the page's template."""
    costs = comparison.costs
    times_us = (None,) * 3 if costs is None else (costs.learning_us, costs.command_us, costs.papers_us)
    learning, command, papers = (_NONE if one is None else f"{one:.1f}" for one in times_us)
    return {
        "compared_seeds": ", ".join(map(str, comparison.seeds)),
        "explored": _explored(comparison),
        "explored_commands": _commands(comparison.by_exploration()),
        "rules": _rules(comparison),
        "alone": _alone(comparison),
        "teachers": _teachers(comparison.teachers),
        "parts": _parts(comparison.parts),
        "parts_text": _parts_text({part.name: part for part in comparison.parts}),
        "learning_us": learning,
        "command_us": command,
        "papers_us": papers,
        "explore_seconds": f"{comparison.seconds:.0f}",
    }


def _explored(comparison: Comparison) -> str:
    columns = ("exploration", "tried on", "error (cm)", "95 % interval of the mean (cm)", "bound (cm)", "")
    body: list[tuple[str, ...]] = []
    for exploration, figures in comparison.by_exploration().items():
        for name, figure in figures.items():
            bound_cm = exploration.patterns_cm if name in PATTERNS else exploration.drawings_cm
            verdict = "holds" if figure.mean_cm <= bound_cm else _FAILS
            cells = (escape(exploration.title), escape(name.replace("_", " ")), str(figure), _interval(figure))
            body.append((*cells, f"{bound_cm:.2f}", verdict))
    body += [(escape(one.exploration.title), _refusal(one), _NONE, _NONE, _NONE, _FAILS) for one in comparison.refused]
    body += [(escape(one.title), _MISSING_ROBOT, _NONE, _NONE, _NONE, "") for one in comparison.missing]
    return table(columns, body)


def _refusal(explored: Explored) -> str:
    return f"seed {explored.seed} was refused: {escape(explored.refused)}"


def _interval(figure: Figure) -> str:
    if figure.interval_cm is None:
        return _NONE
    return f"{figure.mean_cm - figure.interval_cm:.3f} to {figure.mean_cm + figure.interval_cm:.3f}"


def _commands(explorations: Iterable[Exploration]) -> str:
    return "".join(
        f"<li>{escape(one.title)}: {''.join(f'<code>{escape(line)}</code> ' for line in one.commands)}</li>"
        for one in explorations
    )


def _rules(comparison: Comparison) -> str:
    columns = ("rule", *_SUMMARY_COLUMNS, "learning, a tick (µs)", "a command (µs)")
    body = []
    for rule in comparison.rules:
        if not rule.errors:
            body.append((escape(rule.name), NOT_COMPARED, *(_NONE,) * (len(columns) - 2)))
            continue
        name = f"{rule.name}, many epochs" if rule.name == PAPERS_RULE else rule.name
        costs = f"{rule.tick_us:.0f}", f"{rule.command_us:.1f}"
        body.append((escape(name), *map(str, _summary_figures(rule.errors)), *costs))
    return table(columns, body)


def _alone(comparison: Comparison) -> str:
    """Return the table of what explores without a teacher, for equal times of the robot."""
    body = []
    for one in comparison.babbled:
        ours, length = comparison.errors_after(one.exploration), f"{one.exploration.duration_s:g} s"
        if ours:
            body.append((OUR_RULE, length, *map(str, _summary_figures(ours))))
        body.append(("goal babbling, by kinematics alone", length, *map(str, _summary_figures(one.errors))))
    return table(("rule", "robot time", *_SUMMARY_COLUMNS), body)


def _teachers(trials: Iterable[TeacherTrial]) -> str:
    columns = (
        "motion",
        "teacher",
        "error (cm)",
        "margin to a limit",
        "joint speed",
        "comfort cost",
        "distance (cm)",
        "a step (µs)",
    )
    body = []
    for one in trials:
        values = f"{one.error_cm:.3f}", f"{one.limit_margin:z.3f}", f"{one.joint_speed:.2f}", f"{one.comfort:.4f}"
        distance = _NONE if one.self_distance_cm is None else f"{one.self_distance_cm:.2f}"
        body.append((escape(one.motion.replace("_", " ")), one.teacher, *values, distance, f"{one.step_us:.0f}"))
    return table(columns, body)


def _parts(parts: Iterable[ErrorPart]) -> str:
    body = [(escape(part.title), *map(str, _summary_figures(part.errors))) for part in parts]
    return table(("what was learned, and how it is asked", *_SUMMARY_COLUMNS), body)


def _summary_figures(errors: tuple[Mapping[str, HandErrors], ...]) -> list[Figure]:
    """Return the figures of the patterns, and of each hand over all drawings."""
    figures = figures_of(errors)
    return [*(figures[name] for name in PATTERNS), *(drawings_figure(errors, hand) for hand in ("left", "right"))]


def _parts_text(parts: Mapping[str, ErrorPart]) -> str:
    """Return a paragraph on the parts of the error on circles; none of parts that there are not."""
    if not parts:
        return ""
    circles = {name: figures_of(part.errors)[PATTERNS[0]].mean_cm for name, part in parts.items()}
    whole, held, both = circles["papers_rule"], circles["held"], circles["reached_held"]
    drawn = drawings_figure(parts["held"].errors, "right").mean_cm
    covered = drawings_figure(parts["covered_held"].errors, "right").mean_cm
    return (
        f"<p>Of the {whole:.2f} cm on circles, {whole - held:.2f} cm are delay: the reservoir has a target one tick "
        f"before the outputs have what it makes of it, and {held:.2f} cm are left where each target is held for {HOLD} "
        f"ticks, with nothing learned anew. Learned from hands as reached in place of targets, so that the "
        f"teacher's lag is not learned, and held alike, {both:.2f} cm are left. On drawings, which lead beyond "
        f"circles, the held networks are {drawn:.2f} cm off with the right hand; a network that learned from the "
        f"whole volume, held alike, {covered:.2f} cm.</p>"
    )
