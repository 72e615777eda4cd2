"""Draws `topology.png`: which processes of a session publish and subscribe to which topics, and through which router.

Run it anywhere: `python data/pictures/topology.py [PICTURE.png]`.
"""

import sys
from pathlib import Path
from typing import NamedTuple

import matplotlib.style
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch

_BLUE, _VERMILION, _GREY, _PALE = "#0072B2", "#D55E00", "#595959", "#F2F2F2"  # Okabe and Ito; told apart by all
_SIZE_IN, _DPI = (9.5, 4.7), 170
_BOX_WIDTH, _BOX_HEIGHT, _BAR_HEIGHT, _REACH = 2.5, 0.62, 0.56, 1.22  # [in]; `_REACH` is from bar to box
_COLUMNS = (1.6, 4.75, 7.9)  # centres [in]
_MIDDLE = 2.35  # of the bar [in]


class Process(NamedTuple):
    """A process: what it is, what it publishes and what it subscribes to, a line each."""

    name: str
    what: str
    publishes: tuple[str, ...]
    subscribes: tuple[str, ...]


_TICKS = ("/hand/*/target", "/sample/joint_states", "/session/phase")
_COMMANDS, _ACKS = "/joint_commands", "acknowledgements"
_ABOVE = (
    Process("explore", "teacher, drives the robot", (*_TICKS, _COMMANDS), ("joints of the robot", _ACKS)),
    Process("replay", "logs, as they were recorded", ("every topic", "of a log"), (_ACKS,)),
    Process("serve", "learned controller", (_COMMANDS,), ("/hand/*/target", "/session/phase")),
)
_BELOW = (
    Process(
        "robot",
        "simulated with Drake",
        ("/joint_states", "/hand/*/measured", "/tf  /clock", "/robot_description"),
        (_COMMANDS,),
    ),
    Process(
        "learn",
        "online learner",
        ("/learner/output", "/learner/error", "/learner/digest", "/learner/status", _ACKS),
        _TICKS,
    ),
    Process("record", "any key, into MCAP", (_ACKS,), ("everything",)),
)


def draw(path: Path) -> None:
    """Draw the picture to a PNG file."""
    with matplotlib.style.context(["default", {"font.size": 9.0}]):
        figure = Figure(figsize=_SIZE_IN, dpi=_DPI)
        axes = figure.add_axes((0.0, 0.0, 1.0, 1.0), xlim=(0.0, _SIZE_IN[0]), ylim=(0.0, _SIZE_IN[1]))
        axes.set_axis_off()
        _box(axes, _SIZE_IN[0] / 2, _MIDDLE, (_SIZE_IN[0] - 0.5, _BAR_HEIGHT), colour=_GREY)
        _bar_text(axes)
        for side, processes in ((1, _ABOVE), (-1, _BELOW)):
            for x, process in zip(_COLUMNS, processes, strict=True):
                _draw_process(axes, x, side, process)
        figure.savefig(path, metadata={"Software": None})


def _bar_text(axes: Axes) -> None:
    first = "The session that listens (robot, learn or serve; tcp/127.0.0.1:7447) is a router; the rest connect to it."
    second = "A topic is the key reenact/TOPIC. Blue: publishes. Orange: subscribes. An awaited consumer acknowledges."
    axes.text(_SIZE_IN[0] / 2, _MIDDLE + 0.11, first, ha="center", va="center", weight="bold")
    axes.text(_SIZE_IN[0] / 2, _MIDDLE - 0.12, second, ha="center", va="center", color=_GREY)


def _draw_process(axes: Axes, x: float, side: int, process: Process) -> None:
    edge = _MIDDLE + side * _BAR_HEIGHT / 2
    far = edge + side * _REACH
    centre = far + side * _BOX_HEIGHT / 2
    _box(axes, x, centre, (_BOX_WIDTH, _BOX_HEIGHT), colour="black")
    axes.text(x, centre + 0.11, process.name, ha="center", va="center", weight="bold", size=11.0)
    axes.text(x, centre - 0.13, process.what, ha="center", va="center", color=_GREY)
    _arrow(axes, x - 0.12, (far, edge), colour=_BLUE)
    _arrow(axes, x + 0.12, (edge, far), colour=_VERMILION)
    for offset, lines, align, colour in (
        (-0.22, process.publishes, "right", _BLUE),
        (0.22, process.subscribes, "left", _VERMILION),
    ):
        axes.text(x + offset, (far + edge) / 2, "\n".join(lines), ha=align, va="center", color=colour, linespacing=1.35)


def _box(axes: Axes, x: float, y: float, size: tuple[float, float], *, colour: str) -> None:
    corner = x - size[0] / 2, y - size[1] / 2
    shape = "round,pad=0,rounding_size=0.08"
    axes.add_patch(FancyBboxPatch(corner, *size, boxstyle=shape, facecolor=_PALE, edgecolor=colour, linewidth=1.0))


def _arrow(axes: Axes, x: float, ends: tuple[float, float], *, colour: str) -> None:
    style = {"arrowstyle": "-|>", "color": colour, "linewidth": 1.6, "shrinkA": 2, "shrinkB": 2, "mutation_scale": 12}
    axes.annotate("", xy=(x, ends[1]), xytext=(x, ends[0]), arrowprops=style)


if __name__ == "__main__":
    draw(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).with_suffix(".png"))
