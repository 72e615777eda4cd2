"""The paper's figures 4, 5 and 6, drawn anew from our own numbers; equal results give equal bytes."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import matplotlib.style
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pipeline.arrays import Floats
from pipeline.demo.run import PAPER_CM
from pipeline.paper.results import PATTERN_1, PATTERN_2, NetworkEnsemble, PaperResults, drawing_title
from pipeline.robot.config import RobotConfig
from pipeline.views.figures import (
    GREY,
    HAND_COLOURS,
    KEY,
    STYLE,
    WIDTH_IN,
    MotionTest,
    draw_errors,
    draw_panel,
    plane_limits,
    save_figure,
    write_key,
)
from pipeline.views.robot_drawing import RobotDrawing, View

MOTION_TITLES = {PATTERN_1: "Pattern 1, circles", PATTERN_2: "Pattern 2, eight and circle"}

_CURVE_IN = (WIDTH_IN, 3.0)
_PANEL_TEXT_IN = 1.4  # key, title and labels of a row of panels
_STRIP_IN = (WIDTH_IN, 7.2)
_STRIP_VIEW = View(azimuth_deg=18.0, elevation_deg=8.0)
_STRIP_STEP_CM = 62.0  # between two postures
_STRIP_SCALE_CM = 20.0  # length of the bar
_STRIP_KEY = (
    "Seen from ahead, a little from the robot's left and from above: its left hand (blue) is on the right.\n"
    "Rings: where each hand should be. All postures are drawn to one scale, without perspective."
)
_CURVE_KEY = "Black: mean over the networks. Blue band: one standard deviation to both sides."
_STRIP_LOW_CM, _STRIP_HIGH_CM = -14.0, 132.0
_STAGES = 7  # at 10 Hz and a second apart, pattern 2 has seven


@dataclass(frozen=True)
class Picture:
    """A picture of the report.

    Attributes
    ----------
    name : str
        Of its file, without folder.
    figure : str
        The paper's number of it.
    caption : str
        What it shows, for those who read it and those who cannot see it.
    key : str
        How it is to be read; it stands in the picture too.
    """

    name: str
    figure: str
    caption: str
    key: str


def draw_figures(
    paper: PaperResults, out: Path, *, on_picture: Callable[[float], None] = lambda share: None
) -> list[Picture]:
    """Draw all figures as PNG into a folder, and return what they are, in the paper's order.

    Raises
    ------
    ConfigError
        A file cannot be written.
    """
    pictures: list[Picture] = []
    with matplotlib.style.context(["default", STYLE]):
        drawn = [*_figures_of(paper, "4", PATTERN_1), *_figures_of(paper, "5", PATTERN_2), *_figure_6(paper)]
        for picture, figure in drawn:
            save_figure(figure, out / picture.name)
            pictures.append(picture)
            on_picture(len(pictures) / len(drawn))
    return pictures


def _figures_of(paper: PaperResults, number: str, pattern: str) -> list[tuple[Picture, Figure]]:
    """Figure 4 or 5: how a pattern was learned, and what its networks make of other motions."""
    networks, seed = paper.networks[pattern], paper.networks[pattern].seeds[0]
    of_one = f"Paths of the network of seed {seed}, that learned {_short(pattern)}"
    patterns = [_motion_test(paper, networks, name) for name in (PATTERN_1, PATTERN_2)]
    drawings = [_motion_test(paper, networks, name) for name in paper.demonstrations]
    many = f"{len(networks.seeds)} initialisations"
    curve = f"Error of networks that learn {_short(pattern)}, over {many}."
    return [
        (Picture(f"figure{number}a.png", f"{number}a", curve, _CURVE_KEY), _curve_figure(networks)),
        (
            Picture(f"figure{number}bc.png", f"{number}b–c", f"{of_one}: both patterns.", KEY),
            _panels_figure(patterns, _all_tests(paper, (PATTERN_1, PATTERN_2))),
        ),
        (
            Picture(f"figure{number}de.png", f"{number}d–e", f"{of_one}: generated free-hand drawings.", KEY),
            _panels_figure(drawings, _all_tests(paper, paper.demonstrations)),
        ),
    ]


def _figure_6(paper: PaperResults) -> list[tuple[Picture, Figure]]:
    deployed = paper.deployed
    tests = [
        MotionTest(title, deployed.targets, run.reached, run.errors, lateral=paper.robot.lateral, up=paper.robot.up)
        for title, run in (("Learned controller", deployed.learned), ("Teacher", deployed.teacher))
    ]
    paths = "Where the simulated robot's hands went at 10 Hz, commanded over Zenoh by the learned controller, and by "
    strip = "Postures of the simulated robot, a second apart."
    return [
        (Picture("figure6.png", "4c", f"{paths}the teacher.", KEY), _panels_figure(tests, tests)),
        (Picture("figure6_postures.png", "6", strip, _STRIP_KEY), _strip_figure(paper)),
    ]


def _short(pattern: str) -> str:
    return MOTION_TITLES[pattern].split(",")[0].lower()


def _title(name: str, *, is_learned: bool) -> str:
    """Return the title of a panel; that of a drawing has two lines, as three of them share the width."""
    seen = "learned" if is_learned else "never seen"
    if name in MOTION_TITLES:
        return f"{MOTION_TITLES[name]} ({seen})"
    return f"{drawing_title(name).capitalize()}\n{seen}"


def _motion_test(paper: PaperResults, networks: NetworkEnsemble, name: str) -> MotionTest:
    trial, lateral, up = networks.trials[name][0], paper.robot.lateral, paper.robot.up
    title = _title(name, is_learned=name == networks.pattern)
    return MotionTest(title, trial.targets, trial.reached, trial.errors, lateral=lateral, up=up)


def _all_tests(paper: PaperResults, names: Sequence[str]) -> list[MotionTest]:
    """Return the tests of these motions by the networks of both patterns, which are drawn to one scale."""
    return [_motion_test(paper, networks, name) for networks in paper.networks.values() for name in names]


def _curve_figure(networks: NetworkEnsemble) -> Figure:
    figure = Figure(_CURVE_IN, layout="constrained")
    write_key(figure, _CURVE_KEY)
    trial = networks.trials[networks.pattern][0]
    levels = {
        "the paper": PAPER_CM[networks.pattern],
        "linear least squares": networks.linear[networks.pattern].mean_cm,
    }
    if trial.teacher:
        levels["the teacher"] = trial.teacher.mean_cm
    curves = networks.curves_cm
    deviation = curves.std(axis=0, ddof=1) if len(curves) > 1 else np.zeros(curves.shape[1])
    name = f"mean of {len(networks.seeds)}"
    draw_errors(figure.subplots(), curves.mean(axis=0), levels, name=name, spread=deviation)
    return figure


def _panels_figure(tests: Sequence[MotionTest], alike: Sequence[MotionTest]) -> Figure:
    """Draw a row of tests, on the region that holds all of those that are to look alike."""
    low, high = plane_limits(alike)
    width, height = high - low
    height_in = (WIDTH_IN - 0.8) / len(tests) * height / width + _PANEL_TEXT_IN
    figure = Figure((WIDTH_IN, height_in), layout="constrained")
    write_key(figure, KEY)
    panels = figure.subplots(1, len(tests), squeeze=False, sharex=True, sharey=True)[0]
    panels[0].set(xlim=(high[0], low[0]), ylim=(low[1], high[1]), ylabel="height (cm)")
    for panel, test in zip(panels, tests, strict=True):
        draw_panel(panel, test)
    return figure


def _strip_figure(paper: PaperResults) -> Figure:
    figure = Figure(_STRIP_IN, layout="constrained")
    write_key(figure, _STRIP_KEY)
    drawing, deployed = RobotDrawing(paper.robot), paper.deployed
    rows = (("Learned controller", deployed.learned), ("Teacher", deployed.teacher))
    for axes, (title, run) in zip(figure.subplots(2, 1), rows, strict=True):
        _draw_strip(axes, drawing, paper.robot, targets=deployed.targets, joints=run.joints, period_s=deployed.period_s)
        axes.set_title(title, loc="left", fontweight="bold", fontsize=9)
    return figure


def _draw_strip(
    axes: Axes, drawing: RobotDrawing, robot: RobotConfig, *, targets: Floats, joints: Floats, period_s: float
) -> None:
    each = max(1, round(1.0 / period_s), -(-len(joints) // _STAGES))
    right, up, _ = _STRIP_VIEW.axes(robot)
    stages = range(0, len(joints), each)
    for index, stage in enumerate(stages):
        offset = index * _STRIP_STEP_CM
        drawing.draw(axes, joints[stage], view=_STRIP_VIEW, offset_cm=(offset, 0.0))
        for colour, target in zip(HAND_COLOURS.values(), targets[stage].reshape(2, 3), strict=True):
            x, y = 100.0 * float(target @ right) + offset, 100.0 * float(target @ up)
            axes.plot(x, y, "o", markersize=5, markerfacecolor="none", markeredgecolor=colour, markeredgewidth=1.4)
        axes.text(offset, _STRIP_LOW_CM, f"{stage * period_s:g} s", ha="center", va="top", color=GREY)
    right_cm = (len(stages) - 0.45) * _STRIP_STEP_CM
    _draw_scale(axes, right_cm=right_cm - 2.0)
    axes.set(xlim=(-0.55 * _STRIP_STEP_CM, right_cm), ylim=(_STRIP_LOW_CM, _STRIP_HIGH_CM))
    axes.set_aspect("equal")
    axes.set_axis_off()


def _draw_scale(axes: Axes, *, right_cm: float) -> None:
    """Draw a bar of known length in the upper right corner, above the heads."""
    left_cm, height_cm = right_cm - _STRIP_SCALE_CM, _STRIP_HIGH_CM - 3.0
    axes.plot([left_cm, right_cm], [height_cm, height_cm], color=GREY, linewidth=2.0, solid_capstyle="butt")
    axes.text(left_cm - 2.0, height_cm, f"{_STRIP_SCALE_CM:g} cm", ha="right", va="center", color=GREY)
