"""Visuals of an imported robot: bones between its joints, and boxes about the size of its links.

Meshes stay with the model they belong to; these shapes need no file, and every viewer draws them.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import cycle
from xml.etree.ElementTree import Element, SubElement

import numpy as np
from numpy.typing import ArrayLike

from pipeline.arrays import Floats
from pipeline.urdf.description import as_numbers

MATERIALS = {
    "body": (0.93, 0.94, 0.95, 1.0),
    "bone": (0.45, 0.47, 0.50, 1.0),
}
HAND_COLOURS = (  # in recordings too; Okabe and Ito, for all kinds of colour vision
    (0.34, 0.71, 0.91, 1.0),
    (0.90, 0.62, 0.00, 1.0),
    (0.00, 0.62, 0.45, 1.0),
    (0.80, 0.47, 0.65, 1.0),
)

_BONE_RADIUS_M = 0.018
_HAND_RADIUS_M = 0.03
_LEAST_M = 0.005  # what is shorter is not drawn
_DENSITY = 1000.0  # kg/m^3: of water, and about that of limbs
_SLIMMEST = 0.3  # shortest edge of a body, in parts of the longest


@dataclass(frozen=True, eq=False)
class Body:
    """Mass [kg], centre of mass [m] (3,), and inertia about it [kg m^2] (3, 3), all in the axes of the link."""

    mass: float
    centre: Floats
    inertia: Floats


def add_materials(robot: Element, hands: Iterable[str], *, prefix: str) -> None:
    """Add the materials to which the shapes refer; their names begin with `prefix`, for viewers share them."""
    for name, rgba in {**MATERIALS, **dict(zip(hands, cycle(HAND_COLOURS), strict=False))}.items():
        SubElement(SubElement(robot, "material", name=f"{prefix}_{name}"), "color", rgba=as_numbers(rgba))


def add_body(link: Element, body: Body, *, prefix: str) -> None:
    """Draw a body as a box along the link's axes: its shape by the moments of inertia, its volume by the mass.

    The moments alone will not do: models give small links that are there for their joints moments of any size.
    """
    moments = np.diagonal(body.inertia)  # of a box of edges a, b, c: (b^2 + c^2) m / 12 and so on
    edges = np.sqrt(np.maximum(moments.sum() - 2.0 * moments, 0.0))
    edges = np.maximum(edges, _SLIMMEST * edges.max()) if edges.any() else np.ones(3)
    edges *= np.cbrt(body.mass / _DENSITY / edges.prod())
    _add_shape(link, "box", {"size": as_numbers(edges)}, body.centre, (0, 0, 0), f"{prefix}_body")


def add_bone(link: Element, end: ArrayLike, *, prefix: str) -> None:
    """Draw a rod from the link's origin to `end` [m] (3,), with a ball at its far end."""
    x, y, z = (float(value) for value in np.asarray(end))
    length = math.hypot(x, y, z)
    if length < _LEAST_M:
        return
    rpy = (0.0, math.atan2(math.hypot(x, y), z), math.atan2(y, x))  # turns z towards the end
    size = {"radius": as_numbers([_BONE_RADIUS_M]), "length": as_numbers([length])}
    _add_shape(link, "cylinder", size, (x / 2, y / 2, z / 2), rpy, f"{prefix}_bone")
    _add_shape(link, "sphere", {"radius": as_numbers([1.5 * _BONE_RADIUS_M])}, (x, y, z), (0, 0, 0), f"{prefix}_bone")


def add_hand(link: Element, name: str, *, prefix: str) -> None:
    """Draw a ball at the origin of the frame of the hand of this name."""
    _add_shape(link, "sphere", {"radius": as_numbers([_HAND_RADIUS_M])}, (0, 0, 0), (0, 0, 0), f"{prefix}_{name}")


def _add_shape(
    link: Element, kind: str, size: Mapping[str, str], xyz: ArrayLike, rpy: ArrayLike, material: str
) -> None:
    visual = SubElement(link, "visual")
    SubElement(visual, "origin", xyz=as_numbers(xyz), rpy=as_numbers(rpy))
    SubElement(SubElement(visual, "geometry"), kind, dict(size))
    SubElement(visual, "material", name=material)
