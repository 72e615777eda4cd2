"""Picture of a robot's reach: where its hands can be, seen from the side and from above, with posture and boxes."""

from itertools import product
from pathlib import Path

import matplotlib.style
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.spatial import ConvexHull

from pipeline.arrays import Floats
from pipeline.robot.config import RobotConfig
from pipeline.robot_setup.reach import Reach
from pipeline.views.figures import BLACK, GREY, STYLE, WIDTH_IN, save_figure, write_key
from pipeline.views.robot_drawing import RobotDrawing, View

_SIDE, _TOP = "from its right", "from above"
_VIEWS = {_SIDE: (View(-90.0, 0.0), "ahead", "height"), _TOP: (View(180.0, 90.0), "to the right", "ahead")}
_KEY = (
    "Dots: positions of the hands at {samples} postures that fill the joints' ranges; the darker, the higher the "
    "manipulability there.\nGrey: the robot in its comfort posture. Outlines: boxes in which targets are explored."
)
_MARGIN_CM, _TEXT_HEIGHT_IN = 5.0, 1.1
_DOT, _CM = 3.0, 100.0


def draw_reach(robot: RobotConfig, reach: Reach, path: Path) -> None:
    """Draw the reach of a robot's hands as PNG; the same input gives the same bytes with the same matplotlib.

    Parameters
    ----------
    robot : RobotConfig
        The robot.
    reach : Reach
        Samples of its reach.
    path : Path
        File to write; replaced if it exists.

    Raises
    ------
    ConfigError
        The file cannot be written.
    """
    limits = {title: _limits(robot, reach, view) for title, (view, _, _) in _VIEWS.items()}
    steepest = max(float((high[1] - low[1]) / (high[0] - low[0])) for low, high in limits.values())
    with matplotlib.style.context(["default", STYLE]):
        figure = Figure((WIDTH_IN, steepest * WIDTH_IN / len(_VIEWS) + _TEXT_HEIGHT_IN), layout="constrained")
        write_key(figure, _KEY.format(samples=len(reach.hands)))
        drawing = RobotDrawing(robot)
        for axes, (title, (view, right, up)) in zip(figure.subplots(1, len(_VIEWS)), _VIEWS.items(), strict=True):
            _draw_dots(axes, robot, reach, view)
            drawing.draw(axes, robot.comfort, view=view)
            _draw_boxes(axes, robot, view, named=title == _TOP)
            low, high = limits[title]
            axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), xlabel=f"{right} (cm)", ylabel=f"{up} (cm)")
            axes.set_title(f"{robot.name}, {title}", loc="left", fontweight="bold", fontsize=9)
            axes.set_aspect("equal")
            if title == _SIDE:
                axes.axhline(0.0, color=GREY, linewidth=0.6, zorder=0)  # the ground
        save_figure(figure, path)


def _seen(robot: RobotConfig, points: Floats, view: View) -> Floats:
    """Return points (N, 3) [m] as a view shows them, to the right and up [cm], (N, 2)."""
    seen: Floats = _CM * (points @ view.axes(robot)[:2].T)
    return seen


def _limits(robot: RobotConfig, reach: Reach, view: View) -> tuple[Floats, Floats]:
    """Return the corners [cm] of the region that holds all dots and the robot's stand, each (2,)."""
    seen = _seen(robot, np.vstack([reach.hands.reshape(-1, 3), np.zeros(3)]), view)
    return seen.min(axis=0) - _MARGIN_CM, seen.max(axis=0) + _MARGIN_CM


def _draw_dots(axes: Axes, robot: RobotConfig, reach: Reach, view: View) -> None:
    seen = _seen(robot, reach.hands.reshape(-1, 3), view)
    freedom = (reach.manipulability / reach.manipulability.max(axis=0)).ravel()
    order = np.argsort(freedom, kind="stable")
    right, up = seen[order].T
    axes.scatter(right, up, s=_DOT, linewidths=0.0, c=freedom[order], cmap="Blues", vmin=-0.3, vmax=1.0)


def _draw_boxes(axes: Axes, robot: RobotConfig, view: View, *, named: bool) -> None:
    for hand in robot.hands:
        corners = np.array(hand.centre) + np.array(list(product((-1.0, 1.0), repeat=3))) * hand.box
        outline = _outline(_seen(robot, corners, view))
        axes.plot(*outline.T, color=BLACK, linewidth=1.2)
        axes.plot(*_seen(robot, np.array([hand.centre]), view).T, color=BLACK, marker="+", markersize=7)
        if named:
            axes.annotate(hand.name, outline.max(axis=0), xytext=(3, 3), textcoords="offset points", color=BLACK)


def _outline(points: Floats) -> Floats:
    """Return the convex outline of points (N, 2), closed."""
    corners = ConvexHull(points).vertices
    outline: Floats = points[[*corners, corners[0]]]
    return outline
