"""Boxes, cylinders and spheres of size 1 as triangles, to be stretched to any size."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Floats

Faces: TypeAlias = NDArray[np.uint32]

_ROUND = 24  # corners of a circle
_RINGS = 12  # of a sphere, from pole to pole


@dataclass(frozen=True, eq=False)
class Solid:
    """Triangles of a shape between -1 and 1; where it has an edge, vertices are not shared, so that it stays sharp.

    Attributes
    ----------
    vertices : ndarray, shape (V, 3)
        Its vertices.
    faces : ndarray, shape (F, 3)
        The vertices of each triangle, anticlockwise as seen from outside.
    size : callable
        Returns half the extents along x, y and z [m] of one of Pinocchio's shapes of the kind.
    """

    vertices: Floats
    faces: Faces
    size: Callable[[Any], tuple[float, float, float]]


def _joined(*parts: tuple[Floats, Faces]) -> tuple[Floats, Faces]:
    begins = np.cumsum([0, *(len(vertices) for vertices, _ in parts)])
    faces = [faces + np.uint32(begin) for (_, faces), begin in zip(parts, begins, strict=False)]
    return np.concatenate([vertices for vertices, _ in parts]), np.concatenate(faces)


def _turned(*profile: tuple[float, float]) -> tuple[Floats, Faces]:
    """Return the smooth surface that a profile of (radius, height), from the bottom up, makes when it turns about z."""
    angles = np.linspace(0.0, 2.0 * np.pi, _ROUND, endpoint=False)
    rings = [np.column_stack([r * np.cos(angles), r * np.sin(angles), np.full(_ROUND, z)]) for r, z in profile]
    here = np.arange(_ROUND, dtype=np.uint32)
    following = np.roll(here, -1)
    quads = [
        np.stack([here, following, following + _ROUND, here, following + _ROUND, here + _ROUND], axis=1) + ring * _ROUND
        for ring in range(len(profile) - 1)
    ]
    return np.concatenate(rings), np.concatenate(quads).reshape(-1, 3).astype(np.uint32)


def _box() -> tuple[Floats, Faces]:
    square = np.array([[-1.0, -1.0, 1.0], [1.0, -1.0, 1.0], [1.0, 1.0, 1.0], [-1.0, 1.0, 1.0]])
    two = np.array([[0, 1, 2], [0, 2, 3]], dtype=np.uint32)
    halves = [np.roll(sign * square[:: int(sign)], axis, axis=1) for axis in range(3) for sign in (1.0, -1.0)]
    return _joined(*((half, two) for half in halves))


def _cylinder() -> tuple[Floats, Faces]:
    return _joined(_turned((0.0, -1.0), (1.0, -1.0)), _turned((1.0, -1.0), (1.0, 1.0)), _turned((1.0, 1.0), (0.0, 1.0)))


def _sphere() -> tuple[Floats, Faces]:
    angles = np.linspace(0.0, np.pi, _RINGS + 1)
    return _turned(*zip(np.sin(angles), -np.cos(angles), strict=True))


SOLIDS: Mapping[str, Solid] = {
    "Box": Solid(*_box(), lambda shape: tuple(shape.halfSide)),
    "Cylinder": Solid(*_cylinder(), lambda shape: (shape.radius, shape.radius, shape.halfLength)),
    "Sphere": Solid(*_sphere(), lambda shape: (shape.radius,) * 3),
}
"""What is drawn of a robot, by the names that Pinocchio has for it."""
