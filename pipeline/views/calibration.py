"""The picture of a calibration: true distances of the hands beside the deviations that a controller expected."""

import math
from pathlib import Path

import matplotlib.style
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogFormatter, StrMethodFormatter

from pipeline.arrays import Floats
from pipeline.evaluation.trials import Trial
from pipeline.views.figures import GREY, HAND_COLOURS, STYLE, save_figure
from recorders.errors import ConfigError
from recorders.text.wording import hand_label

_SIZE_IN = (9.5, 4.4)
_CM_PER_M = 100.0
_MOST = 3.0  # deviations
_LEGEND_COLUMNS = 3


class _PlainFormatter(LogFormatter):
    """Labels of a logarithmic axis as plain numbers, between powers of ten where it spans few of them.

    There is no room for a 4 beside a 3.
    """

    def __call__(self, x: float, pos: int | None = None) -> str:
        return f"{x:g}" if super().__call__(x, pos) and not f"{x:e}".startswith("4") else ""


def draw_calibration(path: Path, trial: Trial) -> None:
    """Draw expected deviations and true distances of a trial as PNG.

    On the left each hand at each target; on the right the share of true distances within so many deviations, beside
    what a normal distribution has that is alike along three axes.

    Raises
    ------
    ConfigError
        If the controller expected no deviations, or the file cannot be written.
    """
    with matplotlib.style.context(["default", STYLE]):
        save_figure(calibration_figure(trial), path)


def calibration_figure(trial: Trial) -> Figure:
    """Return the picture of `draw_calibration`; raises ConfigError if the controller expected no deviations."""
    if trial.deviations is None:
        raise ConfigError(
            "--plot: expected a controller that knows how far off its commands may be, of a rule such as "
            "forward-inverse and trained, found one that does not"
        )
    figure = Figure(figsize=_SIZE_IN, layout="constrained")
    points, shares = figure.subplots(1, 2)
    _draw_points(points, trial)
    _draw_shares(shares, trial)
    figure.suptitle(f"{trial.name}: {trial.summary()['within_deviation']:.0%} of the distances within one deviation")
    return figure


def _draw_points(panel: Axes, trial: Trial) -> None:
    deviations, distances = _in_cm(trial)
    for hand, (name, colour) in enumerate(zip(trial.errors.hands_cm, _colours(trial), strict=True)):
        panel.scatter(
            deviations[:, hand], distances[:, hand], s=8, color=colour, alpha=0.6, lw=0, label=hand_label(name)
        )
    low = min(deviations.min(), distances.min()) * 0.9
    high = max(deviations.max(), distances.max()) * 1.1
    panel.plot([low, high], [low, high], color=GREY, lw=1, label="equal")
    panel.set(xscale="log", yscale="log", xlabel="expected deviation [cm]", ylabel="true distance from the target [cm]")
    for axis in (panel.xaxis, panel.yaxis):
        axis.set_major_formatter(StrMethodFormatter("{x:g}"))
        axis.set_minor_formatter(_PlainFormatter(minor_thresholds=(2.0, 0.5)))
    _name_lines(panel)


def _draw_shares(panel: Axes, trial: Trial) -> None:
    deviations, distances = _in_cm(trial)
    ratios = distances / deviations
    grid = np.linspace(0.0, _MOST, 200)
    for hand, (name, colour) in enumerate(zip(trial.errors.hands_cm, _colours(trial), strict=True)):
        panel.plot(grid, (ratios[:, hand, np.newaxis] <= grid).mean(axis=0), color=colour, label=hand_label(name))
    panel.plot(grid, _normal_share(grid), color=GREY, lw=1, ls="--", label="normal, in three dimensions")
    panel.axvline(1.0, color=GREY, lw=0.6)
    panel.set(xlabel="deviations", ylabel="share of true distances within", xlim=(0.0, _MOST), ylim=(0.0, 1.02))
    _name_lines(panel)


def _name_lines(panel: Axes) -> None:
    """Put the legend above the panel, where no data are."""
    panel.legend(frameon=False, loc="lower left", bbox_to_anchor=(0.0, 1.0), borderaxespad=0.0, ncols=_LEGEND_COLUMNS)


def _normal_share(deviations: Floats) -> Floats:
    """Return the share of distances within so many deviations of a normal distribution alike along three axes."""
    x = deviations * math.sqrt(3.0)  # in deviations of one axis: Maxwell's distribution
    return np.array([math.erf(v / math.sqrt(2.0)) - math.sqrt(2.0 / math.pi) * v * math.exp(-v * v / 2.0) for v in x])


def _in_cm(trial: Trial) -> tuple[Floats, Floats]:
    return np.asarray(trial.deviations) * _CM_PER_M, trial.distances * _CM_PER_M


def _colours(trial: Trial) -> list[str]:
    known = list(HAND_COLOURS.values())
    return [HAND_COLOURS.get(name, known[place % len(known)]) for place, name in enumerate(trial.errors.hands_cm)]
