"""The result of a training as it is read: what its counts are of, and units."""

from collections.abc import Mapping
from typing import Any

from recorders.text.quantities import decimal_text


def training_lines(result: Mapping[str, Any], cycles: int) -> dict[str, Any]:
    """Return the result of a training, whose counts are of all its cycles, as it is read.

    Examples
    --------
    >>> training_lines({"steps": 400, "ticks": 402}, 2)
    {'steps': '400: 200 in each of 2 cycles', 'ticks': '402: 201 in each of 2 cycles'}
    """
    counts = {name: _in_cycles(result[name], cycles) for name in ("steps", "ticks")}
    return {**result, **counts}


def held_out_lines(errors: Mapping[str, Any], units: Mapping[str, str]) -> dict[str, Any]:
    """Return the errors on what was left aside as they are read, those of joints with their units.

    Examples
    --------
    >>> held_out_lines({"mean_cm": 0.5, "joints": {"knee": {"mean": 0.25, "max": 0.75}}}, {"knee": "rad"})
    {'held_out_mean_cm': 0.5, 'held_out_joint knee': 'mean 0.25 rad, max 0.75 rad'}
    """
    lines = {f"held_out_{name}": value for name, value in errors.items() if name != "joints"}
    joints = {
        f"held_out_joint {joint}": ", ".join(f"{kind} {decimal_text(off)} {units[joint]}" for kind, off in each.items())
        for joint, each in errors["joints"].items()
    }
    return lines | joints


def _in_cycles(count: int, cycles: int) -> int | str:
    if cycles == 1:
        return count
    each, rest = divmod(count, cycles)
    return f"{count} in {cycles} cycles" if rest else f"{count}: {each} in each of {cycles} cycles"
