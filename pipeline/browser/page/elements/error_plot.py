"""Running plot of the errors of all hands over the last seconds."""

from collections.abc import Sequence

import numpy as np
from viser import GuiUplotHandle, ViserServer, uplot

from pipeline.browser.page.colours import css, hand_colour
from pipeline.browser.session.figures import TickError

_POINTS = 200
_SPAN_S = 20.0

AXIS = uplot.Axis(stroke="#888888", grid={"stroke": "rgba(128,128,128,0.25)"})
"""An axis that is seen on a dark page and on a light one."""


def hand_series(unit: str, hands: Sequence[str]) -> tuple[uplot.Series, ...]:
    """Return the series of a plot: of its x axis by unit, and the error of each hand [cm]."""
    series = [uplot.Series(label=unit)]
    for place, hand in enumerate(hands):
        dash = () if place % 2 == 0 else (6.0, 3.0)  # told apart without their colours, too
        series.append(uplot.Series(label=f"{hand} [cm]", stroke=css(hand_colour(place)), width=2, dash=dash))
    return tuple(series)


class ErrorPlot:
    """Plot of the distances of the hands from their targets.

    Parameters
    ----------
    server : ViserServer
        The page.
    hands : sequence of str
        Names of the hands.
    """

    def __init__(self, server: ViserServer, hands: Sequence[str]) -> None:
        self._hands = len(hands)
        begin_s, nothing = np.array([-_SPAN_S, 0.0]), np.full(2, np.nan)  # the page keeps the span of what comes first
        self._plot: GuiUplotHandle = server.gui.add_uplot(
            (begin_s, *[nothing] * self._hands),
            hand_series("s", hands),
            scales={"x": uplot.Scale(time=False, auto=True), "y": uplot.Scale(auto=True)},
            axes=(AXIS, AXIS),
            padding=(12, 12, 0, 0),  # for half of a number
            height=150,
        )

    def show(self, errors: Sequence[TickError]) -> None:
        """Show the errors of the last ticks."""
        if not errors:
            return
        end_s = errors[-1].time_ns * 1e-9
        shown = errors[:: max(1, len(errors) // _POINTS)]
        times_s = np.array([error.time_ns * 1e-9 - end_s for error in shown])
        anew = np.flatnonzero(np.diff(times_s) <= 0.0) + 1  # the robot's clock began anew
        begin = int(anew[-1]) if len(anew) else 0
        begin += int(np.searchsorted(times_s[begin:], -_SPAN_S))
        distances = np.array([error.distances_cm for error in shown])
        self._plot.data = (times_s[begin:], *(distances[begin:, place].copy() for place in range(self._hands)))
