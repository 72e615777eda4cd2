"""Picture of a soak: memory, descriptors, threads and missed messages of each process, over time."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from soak_verdict import MISSED, WARM_UP, missed

_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#000000")  # Okabe and Ito
_ROWS = ("resident memory [MB]", "open descriptors", "threads", "missed messages")
_HOUR_S = 3600.0


def draw(samples: Sequence[dict[str, Any]], result: dict[str, Any], path: Path) -> None:
    """Draw a picture."""
    figure = Figure(figsize=(9.5, 9.0), layout="constrained")
    axes = figure.subplots(len(_ROWS), 1, sharex=True)
    hours = [sample["time_s"] / _HOUR_S for sample in samples]
    for kind, colour in zip(MISSED, _COLOURS, strict=True):
        seen = [(hour, sample) for hour, sample in zip(hours, samples, strict=True) if kind in sample["processes"]]
        times = [hour for hour, _ in seen]
        processes = [sample["processes"][kind] for _, sample in seen]
        series = (
            [process["resident"] / 1e6 for process in processes],
            [process["descriptors"] for process in processes],
            [process["threads"] for process in processes],
            [missed(sample["counts"], kind) for _, sample in seen],
        )
        for axis, values in zip(axes, series, strict=True):
            axis.plot(times, values, color=colour, linewidth=1.0, label=kind)
    _label(axes, end=hours[-1])
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=len(MISSED), frameon=False)
    config = result["config"]
    axes[0].set_title(
        f"{config['hours']:g} h at {config['rate_hz']:g} Hz, "
        f"{'with the clock' if config['real_time'] else 'simulated'}: {result['driven']['ticks']} ticks, "
        f"{result['recording']['messages']} messages recorded",
        fontsize=10,
    )
    figure.savefig(path, dpi=130)


def _label(axes: Sequence[Axes], *, end: float) -> None:
    for axis, name in zip(axes, _ROWS, strict=True):
        axis.set_ylabel(name)
        axis.set_ylim(bottom=0, top=1 if axis.dataLim.y1 == 0 else None)
        axis.axvspan(0.0, end * WARM_UP, color="#EEEEEE", zorder=0)
        axis.spines[["top", "right"]].set_visible(False)
    axes[-1].set_xlabel("hours of the clock; grey: warm-up, not counted")
