"""Robot configs of older forms, as logs and controllers hold them, in the form of today: the one place that knows them.

Until hands were a list, `[hands]` named the links of left and right, or of one of them, and `[pattern]` held their
centres; there was no box. A text is never rewritten: what was recorded stays as it is, to the byte, and is upgraded
whenever it is read.
"""

from collections.abc import Mapping
from typing import Any

from pipeline.robot.toml_values import Vector, as_point, as_table

_SIDES = ("left", "right")
_CENTRES = {side: f"{side}_centre" for side in _SIDES}
_PLANE = ("lateral", "up")

_IN_PLANE_M, _AHEAD_M = 0.25, 0.069  # half extents of the box: in the plane of the patterns, and at right angles to it


def upgraded(table: Mapping[str, Any]) -> dict[str, Any]:
    """Return a parsed robot config with `[[hands]]`, from `[hands]` and `[pattern]` if it is of the older form.

    Raises
    ------
    RobotError
        It is of the older form, and lacks a key or has an unknown one there.
    """
    if not isinstance(table.get("hands"), dict) or "pattern" not in table:
        return dict(table)
    sides = [side for side in _SIDES if side in table["hands"] or _CENTRES[side] in table["pattern"]] or _SIDES
    links = as_table(table["hands"], frozenset(sides), "[hands]")
    pattern = as_table(table["pattern"], frozenset({*(_CENTRES[side] for side in sides), *_PLANE}), "[pattern]")
    box = list(_box(*(as_point(pattern[key], f"[pattern] {key}") for key in _PLANE)))
    hands = [
        {"name": side, "link": links[side], "controls": "position", "centre": pattern[_CENTRES[side]], "box": box}
        for side in sides
    ]
    return {**table, "hands": hands, "pattern": {key: pattern[key] for key in _PLANE}}


def _box(lateral: Vector, up: Vector) -> Vector:
    """Return the half extents [m] along the world's axes of the box that lies in the plane of two unit vectors."""
    ahead = (
        lateral[1] * up[2] - lateral[2] * up[1],
        lateral[2] * up[0] - lateral[0] * up[2],
        lateral[0] * up[1] - lateral[1] * up[0],
    )
    x, y, z = (
        _AHEAD_M * abs(ahead[axis]) + _IN_PLANE_M * abs(lateral[axis]) + _IN_PLANE_M * abs(up[axis])
        for axis in range(3)
    )
    return x, y, z
