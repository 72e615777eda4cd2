"""A learner in a Rerun recording: its errors, the drift of what it learns, and the activity of its reservoir."""

from collections.abc import Mapping, Sequence

import numpy as np
import rerun as rr

from recorders.messages.validation import FloatArray
from recorders.rerun_scene.hands import HAND_COLOURS, hand_colours
from recorders.rerun_scene.track import Instants
from recorders.text.wording import hand_label

_MAIN, _FAINT = (86, 180, 233), (110, 130, 145)
_WEIGHT_COLOURS = ((0, 158, 115), (204, 121, 167), (240, 228, 66))  # green, purple, yellow: Okabe and Ito
_BINS = 40


def send_learning_styles(
    recording: rr.RecordingStream, hands: Sequence[str], weights: Sequence[str] = (), *, spread: Sequence[str] = ()
) -> None:
    """Send names and colours of the curves; `weights` are those that learn, `spread` the arrays shown by their mean."""
    for hand, colour in hand_colours(hands).items():
        style = rr.SeriesLines(names=[hand_label(hand)], colors=[colour], widths=[2.0])
        recording.log(f"learning/error/{hand}", style, static=True)
    for name in spread:
        names = ["mean", "mean - deviation", "mean + deviation"]
        style = rr.SeriesLines(names=names, colors=[_MAIN, _FAINT, _FAINT], widths=[2.0, 1.0, 1.0])
        recording.log(f"drift/{name}", style, static=True)
    colours = [_WEIGHT_COLOURS[i % len(_WEIGHT_COLOURS)] for i in range(len(weights))]
    names = [name.replace("_", " to ") for name in weights]
    recording.log("drift/weights", rr.SeriesLines(names=names, colors=colours, widths=[2.0]), static=True)


def log_errors(recording: rr.RecordingStream, hands_cm: Mapping[str, float]) -> None:
    """Send the mean error of each hand [cm], now."""
    for hand, error_cm in hands_cm.items():
        recording.log(f"learning/error/{hand}", rr.Scalars(error_cm))


def log_drift(
    recording: rr.RecordingStream, spread: Mapping[str, FloatArray], *, moved: Mapping[str, FloatArray]
) -> None:
    """Send mean and spread of arrays by name, and how far weights have moved on the mean, by kind, now."""
    for name, values in spread.items():
        mean, deviation = float(values.mean()), float(values.std())
        recording.log(f"drift/{name}", rr.Scalars([mean, mean - deviation, mean + deviation]))
    recording.log("drift/weights", rr.Scalars([float(np.abs(change).mean()) for change in moved.values()]))


def log_activity(recording: rr.RecordingStream, activity: FloatArray, *, static: bool = False) -> None:
    """Send the activity y of the reservoir, shape (T, neurons), as a picture with time to the right."""
    shades = float(activity.min()), float(activity.max())
    picture = rr.Tensor(activity.T.astype(np.float32), dim_names=("neuron", "time"), value_range=shades)
    recording.log("reservoir/activity", picture, static=static)


def send_network(
    recording: rr.RecordingStream, arrays: Mapping[str, FloatArray], *, errors_cm: Sequence[float]
) -> None:
    """Send how arrays of a learner are distributed, by name, and the error of every epoch [cm], to stay."""
    for name, values in arrays.items():
        counts, edges = np.histogram(values, bins=_BINS)
        middles, widths = (edges[:-1] + edges[1:]) / 2.0, np.diff(edges)
        recording.log(f"network/{name}", rr.BarChart(counts, color=_MAIN, abscissa=middles, widths=widths), static=True)
    if len(errors_cm):
        epochs = np.arange(1.0, len(errors_cm) + 1.0)
        chart = rr.BarChart(np.array(errors_cm), color=HAND_COLOURS["orange"], abscissa=epochs)
        recording.log("network/errors", chart, static=True)


def send_parts(
    recording: rr.RecordingStream, instants: Instants, curves: Mapping[str, FloatArray], lines: Sequence[str]
) -> None:
    """Send curves over the commands, by name, each of shape (T,), and a line on each part, to stay."""
    for place, (name, values) in enumerate(curves.items()):
        recording.log(f"parts/curves/{place}", rr.SeriesLines(names=[name], widths=[2.0]), static=True)
        recording.send_columns(f"parts/curves/{place}", instants.columns(), rr.Scalars.columns(scalars=values))
    recording.log("parts/lines", rr.TextDocument("\n".join(lines)), static=True)
