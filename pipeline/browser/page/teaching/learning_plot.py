"""Plot of the error of a learner over what it has learned from."""

from collections.abc import Sequence

import numpy as np
from viser import GuiUplotHandle, ViserServer, uplot

from pipeline.browser.page.elements.error_plot import AXIS, hand_series
from pipeline.browser.teaching.curve import Curve

_POINTS = 200
_LEAST_CM = 1e-3  # errors below this are drawn as this: the scale is logarithmic


class LearningPlot:
    """Curve of the errors of all hands, on a logarithmic scale; there is none before it has two points.

    Parameters
    ----------
    server : ViserServer
        The page.
    hands : sequence of str
        Names of the hands.
    """

    def __init__(self, server: ViserServer, hands: Sequence[str]) -> None:
        self._hands, self._unit = hands, ""
        self._shown: tuple[int, float | None] = (0, None)
        axis: uplot.Axis = {**AXIS, "ticks": {"show": False}}
        self._plot: GuiUplotHandle = server.gui.add_uplot(
            (np.arange(2.0), *(np.ones(2) for _ in hands)),
            hand_series(self._unit, hands),
            scales={"x": uplot.Scale(time=False, auto=True), "y": uplot.Scale(auto=True, distr=3)},  # logarithmic
            axes=(axis, axis),
            padding=(12, 12, 0, 0),  # for half of a number
            height=160,
            visible=False,
        )

    def show(self, curve: Curve | None) -> None:
        """Show a curve, if there is anything new in it."""
        shown = id(curve), None if curve is None else curve.last_at
        if shown == self._shown:
            return
        self._shown = shown
        points = np.empty((0, 0)) if curve is None else curve.points(_POINTS)
        if curve is None or len(points) < 2:
            self._plot.visible = False
            return
        if curve.unit != self._unit:
            self._unit = curve.unit
            self._plot.series = hand_series(self._unit, self._hands)
        columns = np.ascontiguousarray(points.T)
        columns[1:] = np.maximum(columns[1:], _LEAST_CM)
        self._plot.data = tuple(columns)
        self._plot.visible = True  # last: a page keeps the span of what it shows first
