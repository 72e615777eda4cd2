"""The running plot: the last seconds of the robot's time, of the clock that runs now alone."""

import numpy as np
import pytest

from pipeline.browser.page.elements.error_plot import ErrorPlot
from pipeline.browser.page.gate import Gate
from pipeline.browser.page.server import page_server
from pipeline.browser.session.figures import TickError


def errors(*times_s: float) -> list[TickError]:
    return [TickError(int(time_s * 1e9), np.array([time_s]), {}) for time_s in times_s]


@pytest.mark.parametrize(
    ("times_s", "shown_s"),
    [
        ((1.0, 2.0, 3.0), (-2.0, -1.0, 0.0)),
        ((1.0, 15.0, 30.0), (-15.0, 0.0)),
        ((50.0, 51.0, 0.0, 0.5, 1.0), (-1.0, -0.5, 0.0)),
        ((50.0, 0.0, 9.0, 0.0, 40.0), (0.0,)),
    ],
)
def test_what_is_plotted(times_s, shown_s):
    with page_server(Gate(), port=None, label="") as server:
        plot = ErrorPlot(server, ["tip"])
        plot.show(errors(*times_s))
        times, distances = plot._plot.data
        assert tuple(times) == pytest.approx(shown_s)
        assert tuple(distances) == pytest.approx(times_s[-len(shown_s) :])
