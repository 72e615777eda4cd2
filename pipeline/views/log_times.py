"""The picture of a recording's times: for each topic the steps between messages, and stamps beside log time."""

from collections.abc import Mapping
from pathlib import Path

import matplotlib.style
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, MaxNLocator

from pipeline.arrays import Floats
from pipeline.views.figures import BLACK, GREY, HAND_COLOURS, STYLE, WIDTH_IN, save_figure, write_key
from recorders.errors import ConfigError
from recorders.recovery.intervals import rate_hz
from recorders.recovery.log_times import NO_STAMP, TopicTimes
from recorders.text.wording import escape_control

_STEPS, _STAMPS = HAND_COLOURS.values()  # told apart with all kinds of colour vision
_ROWS = 12  # topics in a picture
_ROW_HEIGHT_IN, _TEXT_HEIGHT_IN = 1.35, 1.3
_BINS = 400  # of time, in each of which least and greatest are drawn
_LONG = 2.0  # usual steps: from there on a step is a gap
_MOST_GAPS = 200
_NS, _MS_PER_S = 1e9, 1e3
_LONGEST_NAME = 60
_FEWEST = 2
_KEY = (
    "Rates are means over the whole time. Left: time from each message to the next; the line is the median, marks are\n"
    "what is {gap:g} times as long or longer. Right: how far stamps are ahead of the times of recording."
)


def draw_log_times(path: Path, times: Mapping[str, TopicTimes], *, title: str) -> None:
    """Draw the times of a recording's topics as PNG, those with most messages; the same input gives the same bytes.

    Parameters
    ----------
    path : Path
        File to write; replaced if it exists.
    times : mapping of str to TopicTimes
        The times, by topic.
    title : str
        Name of the recording.

    Raises
    ------
    ConfigError
        If no topic has two messages, or the file cannot be written.
    """
    several = [topic for topic, each in times.items() if len(each.log_times_ns) >= _FEWEST]
    shown = sorted(several, key=lambda topic: -len(times[topic].log_times_ns))[:_ROWS]
    if not shown:
        raise ConfigError("--plot: expected a topic of two messages or more, found none")
    begin_ns = min(int(times[topic].log_times_ns.min()) for topic in shown)
    end_s = max(int(times[topic].log_times_ns.max()) - begin_ns for topic in shown) / _NS
    with matplotlib.style.context(["default", STYLE]):
        figure = Figure((WIDTH_IN, _TEXT_HEIGHT_IN + _ROW_HEIGHT_IN * len(shown)), layout="constrained")
        panels = figure.subplots(len(shown), 2, squeeze=False, sharex=True)
        for (left, right), topic in zip(panels, shown, strict=True):
            _draw_topic(left, right, topic, times[topic], begin_ns)
        for panel in panels[-1]:
            panel.set(xlabel="time of recording (s)", xlim=(-0.01 * end_s, 1.01 * end_s or 1.0))
        others = len(several) - len(shown)
        more = f" The {others} topics with fewer messages are not shown." if others else ""
        name = escape_control(title[:_LONGEST_NAME]).replace("$", r"\$")
        write_key(figure, f"{name}\n{_KEY.format(gap=_LONG)}{more}")
        save_figure(figure, path)


def _draw_topic(left: Axes, right: Axes, topic: str, times: TopicTimes, begin_ns: int) -> None:
    moments = (times.log_times_ns - begin_ns) / _NS
    steps_ms = np.diff(times.log_times_ns) / _NS * _MS_PER_S
    usual = float(np.median(steps_ms))
    left.set_title(topic_title(topic, times).replace("$", r"\$"), loc="left", fontweight="bold", fontsize=9)
    _draw_range(left, moments[:-1], steps_ms, _STEPS)
    left.axhline(usual, color=BLACK, linewidth=0.7)
    gaps = np.flatnonzero(steps_ms >= _LONG * usual) if usual > 0.0 else np.zeros(0, np.intp)
    longest = gaps[np.argsort(-steps_ms[gaps], kind="stable")][:_MOST_GAPS]
    left.plot(moments[longest], steps_ms[longest], color=BLACK, marker="v", markersize=4, linestyle="none")
    left.set_ylabel("step (ms)")
    left.set_ylim(bottom=min(0.0, float(steps_ms.min())))
    left.yaxis.set_major_locator(MaxNLocator(3))
    _draw_stamps(right, moments, times)


def topic_title(topic: str, times: TopicTimes) -> str:
    """Return a topic's name, number of messages and mean rate, which is that of `info`."""
    name = escape_control(topic)
    name = name if len(name) <= _LONGEST_NAME else f"{name[:_LONGEST_NAME]}…"
    mean_hz = rate_hz(len(times.log_times_ns) - 1, int(np.ptp(times.log_times_ns)))
    return f"{name}: {len(times.log_times_ns)} messages, {'no rate' if mean_hz is None else f'{mean_hz:.2f} Hz'}"


def _draw_stamps(panel: Axes, moments: Floats, times: TopicTimes) -> None:
    there = times.stamps_ns != NO_STAMP
    if not there.any():
        panel.text(0.5, 0.5, "no stamps", color=GREY, ha="center", va="center", transform=panel.transAxes)
        panel.set_yticks([])
        return
    ahead = (times.stamps_ns - times.log_times_ns)[there] / _NS
    in_ms = np.abs(ahead).max() < 1.0
    _draw_range(panel, moments[there], ahead * (_MS_PER_S if in_ms else 1.0), _STAMPS)
    panel.set_ylabel("ahead (ms)" if in_ms else "ahead (s)")
    panel.yaxis.set_major_locator(MaxNLocator(3))
    panel.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:.10g}"))


def _draw_range(panel: Axes, moments: Floats, values: Floats, colour: str) -> None:
    """Draw points, or where there are too many of them least, greatest and mean of those that fall together."""
    if len(moments) <= 2 * _BINS:
        panel.plot(moments, values, color=colour, marker=".", markersize=3, linestyle="none", zorder=1)
        return
    span = float(moments.max() - moments.min()) or 1.0
    bins = np.minimum(((moments - moments.min()) / span * _BINS).astype(np.intp), _BINS - 1)
    order = np.argsort(bins, kind="stable")
    places, starts = np.unique(bins[order], return_index=True)
    sorted_values = values[order]
    least, most = np.minimum.reduceat(sorted_values, starts), np.maximum.reduceat(sorted_values, starts)
    means = np.add.reduceat(sorted_values, starts) / np.diff([*starts, len(order)])
    middles = moments.min() + (places + 0.5) * span / _BINS
    panel.vlines(middles, least, most, color=colour, alpha=0.45, linewidth=1.2, zorder=1)
    panel.plot(middles, means, color=colour, marker=".", markersize=2.5, linestyle="none", zorder=2)
