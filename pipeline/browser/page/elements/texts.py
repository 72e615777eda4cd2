"""Texts of the panel as HTML; whatever comes from elsewhere is escaped."""

from collections.abc import Mapping
from html import escape

from pipeline.arrays import Floats
from pipeline.browser.page.colours import css, hand_colour
from pipeline.robot.config import RobotConfig

_NEAR = 0.05  # of a joint's range: nearer to a limit it is marked
_WARNING = "#d55e00"
_ROW = "display:flex;justify-content:space-between;gap:0.6em;font-size:0.85em;line-height:1.5;padding:0 0.7em"
_JOINT = "flex:0 0 47%;overflow:hidden;text-overflow:ellipsis"
_TRACK = "flex:1;position:relative;height:0.5em;border-radius:0.25em;background:rgba(128,128,128,0.35)"
_MARKER = "position:absolute;top:-0.15em;width:0.4em;height:0.8em;border-radius:0.2em"
_NOTE = "font-size:0.75em;opacity:0.85;padding:0 0.9em 0.3em"
_ERRORS = "Distance from a target to the hand when the next target comes: the lag behind a moving target is in it."
_NUMBER = "font-variant-numeric:tabular-nums;white-space:nowrap"


def paragraph(text: str, *, warning: bool = False, name: str = "") -> str:
    """Return a line of text; a warning has a mark beside its colour. `name` is by which a test finds it."""
    style = f"color:{_WARNING};font-weight:600" if warning else ""
    mark = "&#9888; " if warning else ""
    return (
        f'<div data-reenact="{escape(name)}" style="font-size:0.85em;padding:0.1em 0.7em;{style}">'
        f"{mark}{escape(text)}</div>"
    )


def rows(entries: Mapping[str, str], *, name: str = "") -> str:
    """Return a table of two columns."""
    return "".join(
        f'<div style="{_ROW}"><span>{escape(label)}</span>'
        f'<span data-reenact="{escape(name)}:{escape(label)}" style="{_NUMBER}">{escape(value)}</span></div>'
        for label, value in entries.items()
    )


def hand_rows(
    robot: RobotConfig, errors_cm: Floats, turns_deg: Mapping[str, float], deviations_m: Floats | None, means_cm: Floats
) -> str:
    """Return the errors of all hands as a table: now, on average, and as the controller expects them [cm]; angles."""
    cell = f'style="text-align:right;{_NUMBER}"'
    titles = ("now [cm]", "mean", "expected", *(("turn",) if turns_deg else ()))
    heads = "".join(f"<th {cell}>{title}</th>" for title in titles)
    lines = []
    for place, hand in enumerate(robot.hand_names):
        cells = (
            f"{errors_cm[place]:.2f}",
            f"{means_cm[place]:.2f}" if len(means_cm) else "",
            "" if deviations_m is None else f"{100.0 * deviations_m[place]:.2f}",
            f"{turns_deg[hand]:.1f}°" if hand in turns_deg else "",
        )
        named = zip(("now", "mean", "expected", "turn")[: len(titles)], cells, strict=False)
        numbers = "".join(f'<td data-reenact="{kind}:{escape(hand)}" {cell}>{text}</td>' for kind, text in named)
        dot = f'<span style="color:{css(hand_colour(place))}">&#9679;</span>'
        lines.append(f'<tr><td style="white-space:nowrap">{dot} {escape(hand)}</td>{numbers}</tr>')
    style = "width:calc(100% - 1.4em);margin:0.2em 0.7em;font-size:0.85em;border-collapse:collapse"
    table = f'<table style="{style}"><tr style="opacity:0.75"><td>error</td>{heads}</tr>{"".join(lines)}</table>'
    return table + f'<div data-reenact="errors" style="{_NOTE}">{_ERRORS}</div>'


def joint_rows(robot: RobotConfig, q: Floats) -> str:
    """Return a bar for every joint: where it stands between its limits; near one it is marked."""
    lines = []
    for name, value, lower, upper in zip(robot.joints, q, robot.lower, robot.upper, strict=True):
        share = min(max(0.0, (value - lower) / (upper - lower)), 1.0)
        near = min(share, 1.0 - share) < _NEAR
        colour, mark = (_WARNING, " &#9888;") if near else ("currentColor", "")
        lines.append(
            f'<div style="{_ROW};align-items:center"><span style="{_JOINT}">{escape(name)}{mark}</span>'
            f'<span style="{_TRACK}"><span style="{_MARKER};left:calc({100.0 * share:.1f}% - 0.2em);'
            f'background:{colour}"></span></span></div>'
        )
    return "".join(lines)
