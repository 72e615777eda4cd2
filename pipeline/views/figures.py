"""The picture of a result: where the hands went against where they should, and how the error fell while learning."""

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import matplotlib.style
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, FigureBase
from matplotlib.ticker import FixedLocator, MaxNLocator, NullFormatter, StrMethodFormatter
from numpy.typing import ArrayLike

from pipeline.arrays import Floats
from pipeline.evaluation.errors import HandErrors
from recorders.errors import ConfigError, MotionError
from recorders.text.quantities import decimal_text

HAND_COLOURS = {"left": "#0072B2", "right": "#D55E00"}  # Okabe and Ito: all kinds of colour vision distinguish them
BLACK, GREY, _TARGET_GREY, _BAND = "#000000", "#6B6B6B", "#BDBDBD", "#B8D4E8"
KEY = (
    "Seen from behind the robot, its left on the left. Grey: targets, from the dot on. Colour: where the hands went.\n"
    "Numbers: mean distance of each hand from its targets, what is ahead of this plane or behind it included."
)
STYLE = {
    "font.size": 9.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.linewidth": 0.6,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "lines.solid_capstyle": "round",
}
WIDTH_IN = 9.5
_TITLE_CHARACTERS = 88  # what the width holds
_CURVE_HEIGHT_IN = 2.5
_TEXT_HEIGHT_IN = 1.9  # titles, tick labels and axis labels of all rows
_DPI = 200
_MARGIN_CM = 2.0
_CM_PER_M = 100.0
_TICKS_CM = (0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100)
_LABEL_GAP = 0.085  # least distance between two labels, as a part of the height of the curve


@dataclass(frozen=True, eq=False)
class MotionTest:
    """A motion that was tested: what was asked of the hands and what they did.

    Attributes
    ----------
    title : str
    targets : ndarray
        Positions asked for [m], left hand then right, shape (T, 6).
    reached : ndarray
        Positions reached [m], left then right, shape (T, 2, 3).
    errors : HandErrors
    lateral, up : array_like
        Unit vectors of the robot's plane, to its left and up, world frame, shape (3,).

    Raises
    ------
    MotionError
        Shapes do not fit, there is no sample, a number is not finite, or the plane's vectors are not orthonormal.
    """

    title: str
    targets: Floats
    reached: Floats
    errors: HandErrors
    lateral: ArrayLike = (0.0, 1.0, 0.0)
    up: ArrayLike = (0.0, 0.0, 1.0)

    def __post_init__(self) -> None:
        for name in ("targets", "reached", "lateral", "up"):
            array = np.array(getattr(self, name), dtype=np.float64)
            array.setflags(write=False)
            object.__setattr__(self, name, array)
        shapes, samples = f"{self.targets.shape} and {self.reached.shape}", self.targets.size // 6
        if samples == 0 or self.targets.shape != (samples, 6) or self.reached.shape != (samples, 2, 3):
            raise MotionError(f"test '{self.title}': expected shapes (T, 6) and (T, 2, 3), T >= 1, found {shapes}")
        if not (np.isfinite(self.targets).all() and np.isfinite(self.reached).all()):
            raise MotionError(f"test '{self.title}': expected finite positions, found NaN or infinity")
        if not _is_plane(np.asarray(self.lateral), np.asarray(self.up)):
            raise MotionError(f"test '{self.title}': expected lateral and up to be orthogonal unit vectors")

    def paths_cm(self, hand: int) -> tuple[Floats, Floats]:
        """Target and reached path of a hand [cm], each (T, 2): to the left, up."""
        axes = np.stack([self.lateral, self.up], axis=1)  # (3, 2)
        target = self.targets.reshape(-1, 2, 3)[:, hand]
        return target @ axes * _CM_PER_M, self.reached[:, hand] @ axes * _CM_PER_M


def _is_plane(lateral: Floats, up: Floats) -> bool:
    if lateral.shape != (3,) or up.shape != (3,):
        return False
    axes = np.stack([lateral, up])
    return np.allclose(axes @ axes.T, np.eye(2), rtol=0.0, atol=1e-6)


def draw_report(
    path: Path,
    *,
    tests: Sequence[MotionTest],
    errors_cm: Sequence[float],
    teacher_cm: float,
    linear_cm: float,
    paper_cm: float,
    title: str,
    beside: MotionTest | None = None,
) -> None:
    """Draw the report of a learner as PNG; the same input gives the same bytes with the same matplotlib.

    Above, a panel for each test shows the plane of the patterns from behind the robot, its left hand on the left.
    Below, the error of every epoch stands beside three others.

    Parameters
    ----------
    path : Path
        File to write; replaced if it exists.
    tests : sequence of MotionTest
        At least one.
    errors_cm : sequence of float
        Mean error of each epoch [cm], in order.
    teacher_cm, linear_cm, paper_cm : float
        Mean error of the teacher, of linear least squares on the same data, and of the paper [cm].
    title : str
        What the picture shows, as a sentence.
    beside : MotionTest, optional
        A test of another learner, drawn below the last of `tests` and beside the curve.

    Raises
    ------
    ConfigError
        There is no test or no epoch, an error is not above zero, or the file cannot be written.
    """
    curve = np.array(errors_cm, dtype=np.float64)
    levels = {"the paper": paper_cm, "the teacher": teacher_cm, "linear least squares": linear_cm}
    _check(tests, curve, levels)
    with matplotlib.style.context(["default", STYLE]):
        save_figure(_figure(tests, curve, levels, title, beside), path)


def save_figure(figure: Figure, path: Path) -> None:
    """Write a figure as PNG; the same figure gives the same bytes with the same matplotlib.

    Raises
    ------
    ConfigError
        The file cannot be written.
    """
    try:
        figure.savefig(path, format="png", dpi=_DPI, metadata={"Software": None})
    except OSError as error:
        raise ConfigError(f"cannot write the report '{path}': {error.strerror}") from error


def _check(tests: Sequence[MotionTest], curve: Floats, levels: dict[str, float]) -> None:
    if not tests or curve.size == 0:
        raise ConfigError(f"expected at least one test and one epoch, found {len(tests)} and {curve.size}")
    numbers = np.array([*curve, *levels.values()])
    unfit = numbers[~(np.isfinite(numbers) & (numbers > 0.0))]
    if unfit.size:
        raise ConfigError(f"expected errors above zero, found {unfit[0]} cm")


def _figure(
    tests: Sequence[MotionTest], curve: Floats, levels: dict[str, float], title: str, beside: MotionTest | None
) -> Figure:
    low, high = plane_limits(tests if beside is None else [*tests, beside])
    width, height = high - low
    panel_height_in = WIDTH_IN / len(tests) * height / width
    curve_height_in = _CURVE_HEIGHT_IN if beside is None else panel_height_in + 0.25 * _TEXT_HEIGHT_IN
    figure = Figure((WIDTH_IN, panel_height_in + curve_height_in + _TEXT_HEIGHT_IN), layout="constrained")
    figure.suptitle(textwrap.fill(title, _TITLE_CHARACTERS), x=0.01, ha="left", fontsize=12, fontweight="bold")
    heights = [panel_height_in + 0.5 * _TEXT_HEIGHT_IN, curve_height_in]
    above, below = figure.subfigures(2, 1, squeeze=False, height_ratios=heights)[:, 0]
    write_key(above, KEY)
    panels = above.subplots(1, len(tests), squeeze=False, sharex=True, sharey=True)[0]
    _draw_panels(panels, tests, low, high)
    if beside is not None:
        below, right = below.subfigures(1, 2, width_ratios=[len(tests) - 1, 1])
        _draw_panels([right.subplots()], [beside], low, high)
        right.axes[0].set_ylabel("")  # as above it
    draw_errors(below.subplots(), curve, levels, name="last epoch")
    return figure


def _draw_panels(panels: Sequence[Axes], tests: Sequence[MotionTest], low: Floats, high: Floats) -> None:
    """Draw a row of tests within the same corners [cm]."""
    panels[0].set(xlim=(high[0], low[0]), ylim=(low[1], high[1]), ylabel="height (cm)")  # left on the left
    for panel, test in zip(panels, tests, strict=True):
        draw_panel(panel, test)


def write_key(figure: FigureBase, key: str) -> None:
    """Write above the panels of a figure how they are to be read."""
    figure.suptitle(key, x=0.01, ha="left", fontsize=9, color=GREY)


def plane_limits(tests: Sequence[MotionTest]) -> tuple[Floats, Floats]:
    """Return the corners [cm] of the region that holds every path of every test, each (2,): to the left, up."""
    points = np.concatenate([path for test in tests for hand in (0, 1) for path in test.paths_cm(hand)])
    return points.min(axis=0) - _MARGIN_CM, points.max(axis=0) + _MARGIN_CM


def draw_panel(panel: Axes, test: MotionTest) -> None:
    """Draw where the hands went against where they should, in the plane of the patterns [cm], from behind the robot."""
    for hand, colour in enumerate(HAND_COLOURS.values()):
        target, reached = test.paths_cm(hand)
        panel.plot(*target.T, color=_TARGET_GREY, linewidth=2.8)
        panel.plot(*reached.T, color=colour, linewidth=0.9)
        # Where the target starts; all there is of one that does not move.
        panel.plot(*target[0], color=GREY, marker="o", markersize=5, markeredgecolor="white")
    panel.set_title(test.title, loc="left", fontweight="bold", fontsize=9, pad=16)
    for x, (name, error_cm) in enumerate(test.errors.hands_cm.items()):
        label = f"{name}: {decimal_text(error_cm)} cm"
        panel.text(x, 1.03, label, color=HAND_COLOURS[name], ha=name, transform=panel.transAxes)
    panel.set_aspect("equal")
    panel.set_xlabel("left of the robot's middle (cm)")


def draw_errors(
    axes: Axes, curve: Floats, levels: dict[str, float], *, name: str = "this network", spread: Floats | None = None
) -> None:
    """Draw the errors [cm] of epochs, shape (epochs,), named at the end, with what they are to be compared with.

    With a `spread` [cm], shape (epochs,), the curve is a mean and the band about it as wide to both sides.
    """
    epochs = np.arange(1, curve.size + 1)
    axes.plot(epochs, curve, color=BLACK, linewidth=1.4, marker="o", markersize=4, markevery=[-1], clip_on=False)
    for level in levels.values():
        axes.axhline(level, color=GREY, linewidth=0.8, zorder=0)
    values = np.array([*curve, *levels.values()])
    if spread is not None:
        below = np.maximum(curve - spread, 0.5 * curve)  # the axis is logarithmic: nothing is drawn at zero
        axes.fill_between(epochs, below, curve + spread, color=_BAND, linewidth=0.0)
        values = np.concatenate([values, below, curve + spread])
    axes.set(xlim=(1, max(2, curve.size)), xlabel="epoch", yscale="log", ylim=(0.85 * values.min(), 1.1 * values.max()))
    axes.set_title("Mean error of both hands (cm) while learning", loc="left", fontweight="bold", fontsize=9)
    axes.xaxis.set_major_locator(MaxNLocator("auto", steps=(1, 2, 2.5, 5, 10), integer=True))
    axes.yaxis.set_major_locator(FixedLocator(_TICKS_CM))
    axes.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axes.yaxis.set_minor_formatter(NullFormatter())
    _label_lines(axes, levels | {name: float(curve[-1])}, bold=name)


def _label_lines(axes: Axes, values: dict[str, float], *, bold: str) -> None:
    """Name each line at its right end; where two names would overlap, one moves up and a stroke leads to it."""
    above = -np.inf
    for name, value in sorted(values.items(), key=lambda item: item[1]):
        _, height = axes.transAxes.inverted().transform(axes.transData.transform((1.0, value)))
        above = max(height, above + _LABEL_GAP)
        axes.plot([1.006, 1.018], [height, above], color=GREY, linewidth=0.6, transform=axes.transAxes, clip_on=False)
        weight, colour = ("bold", BLACK) if name == bold else ("normal", GREY)
        label = f"{name}: {value:.2f}"
        axes.text(1.022, above, label, color=colour, fontweight=weight, va="center", transform=axes.transAxes)
