"""The layouts in which Rerun's viewer shows a motion, a learner at work, and a learned controller."""

from collections.abc import Mapping, Sequence
from itertools import cycle
from typing import Literal

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from recorders.messages.validation import FloatArray
from recorders.rerun_scene.hands import HAND_COLOURS, FrontalPlane
from recorders.rerun_scene.robot import GAUGES, LABEL_AT, ROW_HEIGHT
from recorders.rerun_scene.track import TIMELINE
from recorders.text.wording import hand_label

EPOCHS = "epoch"
"""Timeline of a learner that is presented a motion again and again."""

_EYE_M = np.array([0.95, 0.6, 0.3])  # from the hands: ahead, to the side, up
_MARGIN_CM = 6.0
_TRAIL_S = 20.0
_LEAST_RANGE_CM = 0.1


def motion_blueprint(
    points: FloatArray, plane: FrontalPlane, *, joints: int, top_cm: float, live: bool = False, learning: bool = False
) -> rrb.Blueprint:
    """Lay out a robot that follows a motion: robot and hands on the left, joints and errors on the right.

    Parameters
    ----------
    points : ndarray, shape (N, 3)
        What must be in sight [m].
    plane : FrontalPlane
        How the hands are seen in the plane.
    joints : int
        How many there are.
    top_cm : float
        Largest distance of a hand from its target [cm], as far as is known.
    live : bool
        Whether to follow what comes, rather than to play what is there.
    learning : bool
        Whether the recording has errors of a learner too.
    """
    errors = [_errors_view(top_cm), *([_learning_errors(None)] if learning else [])]
    right = rrb.Vertical(_joints_tabs(joints), *errors, row_shares=[2.2, *[1.0] * len(errors)])
    return _blueprint(_robot_and_hands(points, plane), right, timeline=TIMELINE, live=live)


def learning_blueprint(
    points: FloatArray,
    plane: FrontalPlane,
    *,
    joints: int,
    timeline: str,
    top_cm: float,
    spread: Mapping[str, str],
    activity: bool,
) -> rrb.Blueprint:
    """Lay out a learner at work: what it does with the motion on the left, what becomes of it on the right.

    `top_cm` is its error at the start [cm]; `spread` are titles of small panels by the array that one shows; the other
    parameters are those of `motion_blueprint`.
    """
    panels = [_curves(f"/drift/{name}", title, corner="rightbottom") for name, title in spread.items()]
    left = rrb.Vertical(
        _scene(points, plane.hands),
        rrb.Horizontal(_frontal(points, plane), _joints_tabs(joints)),
        row_shares=[3, 2],
    )
    right = rrb.Vertical(
        _learning_errors(top_cm),
        _curves("/drift/weights", "Output weights: mean |w - w at the start|", corner="rightbottom"),
        *([rrb.Horizontal(*panels)] if panels else []),
        *([_activity()] if activity else []),
    )
    return _blueprint(left, right, timeline=timeline, live=True)


def controller_blueprint(
    points: FloatArray,
    plane: FrontalPlane,
    *,
    joints: int,
    top_cm: float,
    spread: Mapping[str, str],
    activity: bool,
    parts: bool = False,
) -> rrb.Blueprint:
    """Lay out a learned controller: its motion on the left, the network and how it was learned on the right.

    The parameters are those of `learning_blueprint`, and `parts` is whether the parts of commands are shown.
    """
    network = rrb.Vertical(
        rrb.Horizontal(_joints_tabs(joints), *([_activity()] if activity else []), *([_parts()] if parts else [])),
        rrb.Horizontal(
            _errors_view(top_cm), rrb.BarChartView(origin="/network/errors", name="Error of each epoch [cm]")
        ),
        rrb.Horizontal(
            *(rrb.BarChartView(origin=f"/network/{name}", name=title) for name, title in spread.items()),
            rrb.BarChartView(origin="/network/weights", name="Changes of weights"),
        ),
        row_shares=[2, 1.2, 1.2],
    )
    return _blueprint(_robot_and_hands(points, plane), network, timeline=TIMELINE, live=False)


def _blueprint(left: rrb.Container, right: rrb.Container, *, timeline: str, live: bool) -> rrb.Blueprint:
    if live:
        panel = rrb.TimePanel(timeline=timeline, state="collapsed", play_state="following")
    else:
        panel = rrb.TimePanel(timeline=timeline, state="collapsed", play_state="playing", loop_mode="all")
    return rrb.Blueprint(rrb.Horizontal(left, right, column_shares=[1, 1]), panel, collapse_panels=True)


def _robot_and_hands(points: FloatArray, plane: FrontalPlane) -> rrb.Vertical:
    return rrb.Vertical(_scene(points, plane.hands), _frontal(points, plane), row_shares=[2, 1])


def _scene(points: FloatArray, hands: Sequence[str]) -> rrb.Spatial3DView:
    """Look at the hands from ahead of the robot, which stands at the origin; the hands leave a trail."""
    middle = points.mean(axis=0)  # (3,)
    ahead = np.array([middle[0], middle[1], 0.0])
    distance = np.linalg.norm(ahead)
    ahead = ahead / distance if distance > 0.0 else np.array([1.0, 0.0, 0.0])
    side, up = np.array([-ahead[1], ahead[0], 0.0]), np.array([0.0, 0.0, 1.0])
    shown = ", ".join(f"{hand_label(hand)} {colour}" for hand, colour in zip(hands, cycle(HAND_COLOURS), strict=False))
    return rrb.Spatial3DView(
        name=f"Robot: {shown}, targets grey",
        contents=["/robot/**", "/hands/**"],
        defaults=[shape.from_fields(fill_mode="solid") for shape in (rr.Boxes3D, rr.Cylinders3D, rr.Ellipsoids3D)],
        overrides={f"hands/{hand}/reached": _trail() for hand in hands},
        eye_controls=rrb.EyeControls3D(
            position=middle + _EYE_M @ np.stack([ahead, side, up]), look_target=middle, eye_up=up
        ),
    )


def _frontal(points: FloatArray, plane: FrontalPlane) -> rrb.Spatial2DView:
    seen = plane.picture_cm(points)  # (N, 2)
    low, high = seen.min(axis=0) - _MARGIN_CM, seen.max(axis=0) + _MARGIN_CM
    return rrb.Spatial2DView(
        origin="/frontal",
        name="The hands from behind the robot [cm]",
        overrides={f"frontal/{hand}/reached": _trail() for hand in plane.hands},
        visual_bounds=rrb.VisualBounds2D(x_range=(low[0], high[0]), y_range=(low[1], high[1])),
    )


def _trail() -> rrb.VisibleTimeRanges:
    start = rrb.TimeRangeBoundary.cursor_relative(seconds=-_TRAIL_S)
    return rrb.VisibleTimeRanges(timeline=TIMELINE, start=start, end=rrb.TimeRangeBoundary.cursor_relative())


def _joints_tabs(joints: int) -> rrb.Tabs:
    gauges = rrb.Spatial2DView(
        origin=f"/{GAUGES}",
        name="Joints between their limits",
        visual_bounds=rrb.VisualBounds2D(
            x_range=(LABEL_AT - 50.0, 115.0), y_range=(-2.0 * ROW_HEIGHT, (joints + 1) * ROW_HEIGHT)
        ),
    )
    # Fifteen names would cover the plot; the cursor shows the name of a line.
    values = rrb.TimeSeriesView(origin="/joints", name="Joint positions", plot_legend=rrb.PlotLegend(visible=False))
    return rrb.Tabs(gauges, values, active_tab=0)


def _errors_view(top_cm: float) -> rrb.TimeSeriesView:
    return rrb.TimeSeriesView(
        origin="/error",
        name="Hands from their targets [cm]",
        plot_legend=rrb.PlotLegend(corner="righttop"),
        axis_y=rrb.ScalarAxis(range=(0.0, 1.1 * max(top_cm, _LEAST_RANGE_CM))),
    )


def _learning_errors(top_cm: float | None) -> rrb.TimeSeriesView:
    axis = None if top_cm is None else rrb.ScalarAxis(range=(0.0, 1.1 * max(top_cm, _LEAST_RANGE_CM)))
    return _curves("/learning/error", "Error of each epoch [cm]", corner="righttop", axis=axis)


def _curves(
    origin: str, name: str, *, corner: Literal["righttop", "rightbottom"], axis: rrb.ScalarAxis | None = None
) -> rrb.TimeSeriesView:
    return rrb.TimeSeriesView(origin=origin, name=name, plot_legend=rrb.PlotLegend(corner=corner), axis_y=axis)


def _activity() -> rrb.TensorView:
    return rrb.TensorView(
        origin="/reservoir/activity",
        name="Reservoir activity y",
        scalar_mapping=rrb.TensorScalarMapping(colormap="viridis"),
        view_fit="fill",
    )


def _parts() -> rrb.Vertical:
    lines = rrb.TextDocumentView(origin="/parts/lines", name="Models")
    return rrb.Vertical(_curves("/parts/curves", "Parts of each command", corner="righttop"), lines, row_shares=[3, 1])


def stack_points(*paths: Sequence[FloatArray] | FloatArray) -> FloatArray:
    """Return all the points [m] of paths (..., 3), shape (N, 3)."""
    return np.concatenate([np.asarray(path).reshape(-1, 3) for path in paths])
