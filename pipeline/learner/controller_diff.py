"""The first difference between two controllers: which setting or which element, and what either holds."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from typing import Any

import numpy as np

from pipeline.arrays import Floats
from pipeline.learner.controller import Controller
from pipeline.learner.rule import place_name
from recorders.text.wording import value_text
from replay.diff.fields import ABSENT, format_pair

ElementName = Callable[[str, tuple[int, ...]], str]
"""Names an element of an array, such as `a[17]`, by the array's name and the element's place."""


@dataclass(frozen=True, slots=True)
class ControllerDifference:
    """The first thing that differs in two controllers A and B.

    Parameters
    ----------
    name : str
        `config.seed`, `joints[3]`, `robot_urdf line 12`, `reservoir_output_weights[17]`, or as the rule names it.
    a, b : str
        What either holds there; floats in full precision.
    differing, size : int
        How many elements of this array differ, and how many it has; 1 of 1 where it is no array.
    """

    name: str
    a: str
    b: str
    differing: int = 1
    size: int = 1

    def __str__(self) -> str:
        line = f"{self.name}: {self.a} in A, {self.b} in B"
        return line if self.size == 1 else f"{line}; {self.differing} of its {self.size} elements differ"


def first_difference(a: Controller, b: Controller) -> ControllerDifference | None:
    """Return the first difference of two controllers, None if they are the same.

    Configuration, constants, joints and robot come first, then the state in the order in which it is digested, then
    the u that waits for its target. Where they came from does not count.
    """
    parts = (
        _of_settings({"rule": a.rule} | a.config.to_dict(), {"rule": b.rule} | b.config.to_dict()),
        None if a.pairs == b.pairs else ControllerDifference("pairs", a.pairs, b.pairs),
        first_difference_of_arrays(_constants(a), _constants(b)),
        _of_lists("joints[{}]", a.joints, b.joints),
        _of_lists("robot_toml line {}", a.robot_toml.split("\n"), b.robot_toml.split("\n"), first=1),
        _of_lists("robot_urdf line {}", a.robot_urdf.split("\n"), b.robot_urdf.split("\n"), first=1),
        first_difference_of_arrays(
            {**a.state, "pending": a.pending}, {**b.state, "pending": b.pending}, element_name=a.config.element_name
        ),
    )
    return next((part for part in parts if part is not None), None)


def first_difference_of_arrays(
    a: Mapping[str, Floats], b: Mapping[str, Floats], *, element_name: ElementName = place_name
) -> ControllerDifference | None:
    """Return the first element, in the order of the names of `a`, whose bits differ in two sets of float64 arrays."""
    for name in {**a, **b}:
        if name not in a or name not in b:
            present = ["present" if name in arrays else ABSENT for arrays in (a, b)]
            return ControllerDifference(name, present[0], present[1])
        difference = _of_arrays(name, np.asarray(a[name]), np.asarray(b[name]), element_name)
        if difference is not None:
            return difference
    return None


def _constants(controller: Controller) -> dict[str, Floats]:
    return {name: getattr(controller, name) for name in ("input_centre", "output_centre")}


def _of_arrays(name: str, a: Floats, b: Floats, element_name: ElementName) -> ControllerDifference | None:
    if a.shape != b.shape:
        return ControllerDifference(name, f"shape {a.shape}", f"shape {b.shape}")
    flat_a, flat_b = np.ravel(a), np.ravel(b)
    differing = np.flatnonzero(flat_a.view(np.uint64) != flat_b.view(np.uint64))
    if not len(differing):
        return None
    first = differing[0]
    place = element_name(name, tuple(map(int, np.unravel_index(first, a.shape))))
    values = format_pair(float(flat_a[first]), float(flat_b[first]))
    return ControllerDifference(place, *values, differing=len(differing), size=a.size)


def _of_settings(a: Mapping[str, Any], b: Mapping[str, Any], *, within: str = "config") -> ControllerDifference | None:
    for name in {**a, **b}:
        value, other, where = a.get(name), b.get(name), f"{within}.{name}"
        if value == other:
            continue
        if isinstance(value, dict) and isinstance(other, dict):
            return _of_settings(value, other, within=where)
        if isinstance(value, list) and isinstance(other, list):
            return _of_lists(where + "[{}]", value, other)
        return ControllerDifference(where, *format_pair(_plain(value), _plain(other)))
    return None


def _plain(value: Any) -> int | float | str:
    return value if isinstance(value, int | float | str) else value_text(value)


def _of_lists(name: str, a: Sequence[Any], b: Sequence[Any], *, first: int = 0) -> ControllerDifference | None:
    for place, (x, y) in enumerate(zip_longest(a, b), first):
        if x != y:
            values = format_pair("" if x is None else x, "" if y is None else y)
            shown = [ABSENT if item is None else text for item, text in zip((x, y), values, strict=True)]
            return ControllerDifference(name.format(place), shown[0], shown[1])
    return None
