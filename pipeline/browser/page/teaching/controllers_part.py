"""Part of the panel that puts controllers side by side: the errors of each over a round of the motion."""

from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

from viser import ViserServer

from pipeline.arrays import Floats
from pipeline.browser.page.colours import css, hand_colour
from pipeline.browser.page.elements.texts import paragraph
from pipeline.browser.session.figures import Round
from pipeline.browser.session.play import Play

_TABLE = "width:calc(100% - 1.4em);margin:0.2em 0.7em;font-size:0.85em;border-collapse:collapse"
_CELL = "text-align:right;padding-left:0.4em;font-variant-numeric:tabular-nums;white-space:nowrap"
_NAME = "overflow-wrap:anywhere;min-width:5em"
_LEADS = "&#9654;&nbsp;"
_OTHERS = "whoever serves"


class ControllersPart:
    """Table of all controllers, by the motion that is gone through.

    Parameters
    ----------
    server : ViserServer
        The page.
    play : Play
        What runs.
    """

    def __init__(self, server: ViserServer, play: Play) -> None:
        self._play = play
        with server.gui.add_folder("Controllers side by side", order=35):
            self._table: Any = server.gui.add_html("")

    def show(self) -> None:
        """Show the figures of now."""
        play = self._play
        loop = play.drive.snapshot().loop
        if loop is None:
            content = paragraph("Choose a motion: each controller is measured over a round of it.")
        else:
            names = ("",) if play.controllers is None else play.controllers.names
            rounds = play.drive.rounds()
            table = rounds_table(play.robot.hand_names, names, rounds, leading=play.link.controller)
            title = f"Errors over the last round of {loop.name:.40}: mean / largest [cm]"
            content = paragraph(title, name="rounds") + table
        if self._table.content != content:
            self._table.content = content


def rounds_table(hands: Sequence[str], names: Sequence[str], rounds: Mapping[str, Round], *, leading: str) -> str:
    """Return the figures of controllers as a table: a row for each, a column for each hand; the one that leads marked.

    Parameters
    ----------
    hands, names : sequence of str
        Names of the hands, and of the controllers in order.
    rounds : mapping of str to Round
        What was driven of a round, by controller; those that are missing drove nothing.
    leading : str
        The controller that leads.
    """
    dots = [f'<span style="color:{css(hand_colour(place))}">&#9679;</span>' for place in range(len(hands))]
    titles = [f"{dot} {escape(hand)}" for dot, hand in zip(dots, hands, strict=True)]
    heads = "".join(f'<th style="{_CELL};font-weight:400">{title}</th>' for title in (*titles, "driven"))
    lines = [f'<tr style="opacity:0.75"><td></td>{heads}</tr>']
    for name in names:
        cells = "".join(
            f'<td style="{_CELL}" data-reenact="{escape(kind)}:{escape(name)}">{text}</td>'
            for kind, text in zip((*hands, "driven"), _texts(rounds.get(name), len(hands)), strict=True)
        )
        mark, weight = (_LEADS, 600) if name == leading else ("", 400)
        lines.append(f'<tr><td style="{_NAME};font-weight:{weight}">{mark}{escape(name or _OTHERS)}</td>{cells}</tr>')
    return f'<table style="{_TABLE}">{"".join(lines)}</table>'


def _texts(found: Round | None, hands: int) -> list[str]:
    """Return the texts of the cells of a controller."""
    if found is None:
        return [*["&ndash;"] * hands, "0 %"]
    means_cm: Floats = found.mean.hands_cm
    pairs = zip(means_cm, found.largest_cm, strict=True)
    return [*(f"{mean_cm:.2f} / {largest_cm:.2f}" for mean_cm, largest_cm in pairs), f"{100.0 * found.share:.0f} %"]
