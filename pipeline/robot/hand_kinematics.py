"""Poses of the hands in a fixed order of IEEE operations: the same bits whatever library or processor there is.

`pipeline.robot.kinematics` asks Pinocchio for the same, whose bits are those of its build: no learner may learn them.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, TypeAlias
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import ArrayLike

from pipeline.arrays import Floats
from pipeline.robot.config import RobotConfig
from pipeline.robot.size import SLIDING, hand_chains
from pipeline.trigonometry import sine_and_cosine
from recorders.errors import JointError

_Vector: TypeAlias = tuple[Any, Any, Any]  # of numbers, or of arrays with a number for each posture
_Matrix: TypeAlias = tuple[_Vector, _Vector, _Vector]

_ORIGIN = (0.0, 0.0, 0.0)
_ALONG_X = "1 0 0"  # the axis of a joint whose URDF names none


class _Placement(NamedTuple):
    """A frame within another: its axes, the columns of its rotation, and its origin [m]."""

    axes: _Matrix
    origin: _Vector


class _Joint(NamedTuple):
    """A joint that moves: its place in a posture, whether it slides, its unit axis, and its frame in the one before."""

    place: int
    slides: bool
    axis: _Vector
    placement: _Placement


class _Chain(NamedTuple):
    """A hand within the frame of the last joint that moves it, and the joints that do, the last first."""

    tip: _Placement
    joints: tuple[_Joint, ...]


class HandKinematics:
    """Hands of a robot as functions of its posture, each followed from its link to the ground.

    A vector v of a link that turns by q about the unit axis a is cos(q) v + sin(q) a x v + (1 - cos(q)) (a v) a
    (Rodrigues' formula), and is seen from the frame before through the joint's origin in the URDF. Many postures at
    once give the bits that each gives alone.

    Parameters
    ----------
    robot : RobotConfig
        Its joints give the order of postures, its hands that of poses.
    """

    def __init__(self, robot: RobotConfig) -> None:
        places = {name: place for place, name in enumerate(robot.joints)}
        self._size = len(places)
        self._chains = [_chain(joints, places) for joints in hand_chains(robot)]

    def positions(self, q: ArrayLike) -> Floats:
        """Return the positions of the hands in the world [m], shape (..., hands, 3).

        Parameters
        ----------
        q : array_like, shape (..., n)
            A posture, or many [rad or m].

        Raises
        ------
        ConfigError
            If an angle is beyond `pipeline.trigonometry.MOST_TURNED_RAD`.
        JointError
            If a posture has another number of joints than the robot.
        """
        posture, waves = self._motions(q)
        hands = [_to_ground(chain.joints, [chain.tip.origin], posture, waves) for chain in self._chains]
        return _stacked([vectors[0] for vectors in hands])

    def poses(self, q: ArrayLike) -> tuple[Floats, Floats]:
        """Return positions as `positions` does, and rotations of the hands' links, shape (..., hands, 3, 3).

        The columns of a rotation are the axes of the link in the world.
        """
        posture, waves = self._motions(q)
        hands = [
            _to_ground(chain.joints, [chain.tip.origin, *chain.tip.axes], posture, waves) for chain in self._chains
        ]
        positions, *axes = (_stacked([vectors[rank] for vectors in hands]) for rank in range(4))
        return positions, np.stack(axes, axis=-1)

    def _motions(self, q: ArrayLike) -> tuple[list[Any], list[tuple[Any, Any]]]:
        """Return every joint's position, and its sine and cosine: numbers for one posture, arrays for many."""
        postures = np.asarray(q, dtype=np.float64)
        if postures.shape[-1:] != (self._size,):
            raise JointError(f"expected postures of {self._size} joints, found an array of shape {postures.shape}")
        columns = np.moveaxis(postures, -1, 0)
        sines, cosines = sine_and_cosine(columns)
        if postures.ndim == 1:  # Python's numbers are the same numbers, ten times as fast
            return columns.tolist(), list(zip(sines.tolist(), cosines.tolist(), strict=True))
        return list(columns), list(zip(sines, cosines, strict=True))


def _to_ground(
    joints: Sequence[_Joint], vectors: list[_Vector], posture: Sequence[Any], waves: Sequence[tuple[Any, Any]]
) -> list[_Vector]:
    """Return vectors of a hand in the world: the first is a point [m], the others are directions."""
    for place, slides, axis, placement in joints:
        if slides:
            vectors = [_plus(posture[place], axis, vectors[0]), *vectors[1:]]
        else:
            vectors = [_turned(axis, *waves[place], vector) for vector in vectors]
        vectors = [_seen(placement, vectors[0]), *(_seen_direction(placement.axes, v) for v in vectors[1:])]
    return vectors


def _turned(axis: _Vector, sin: Any, cos: Any, vector: _Vector) -> _Vector:
    """Return a vector turned about a unit axis by an angle of which sine and cosine are given."""
    (a, b, c), (x, y, z) = axis, vector
    along = (1.0 - cos) * (a * x + b * y + c * z)
    return (
        cos * x + sin * (b * z - c * y) + along * a,
        cos * y + sin * (c * x - a * z) + along * b,
        cos * z + sin * (a * y - b * x) + along * c,
    )


def _plus(along: Any, axis: _Vector, point: _Vector) -> _Vector:
    """Return a point moved along an axis."""
    (a, b, c), (x, y, z) = axis, point
    return x + along * a, y + along * b, z + along * c


def _seen(placement: _Placement, point: _Vector) -> _Vector:
    """Return a point of a placed frame, from the one that it is placed in."""
    (x, y, z), (a, b, c) = _seen_direction(placement.axes, point), placement.origin
    return x + a, y + b, z + c


def _seen_direction(axes: _Matrix, direction: _Vector) -> _Vector:
    """Return a direction in a frame of these axes, from the one that they are given in."""
    ((xx, yx, zx), (xy, yy, zy), (xz, yz, zz)), (x, y, z) = axes, direction
    return xx * x + xy * y + xz * z, yx * x + yy * y + yz * z, zx * x + zy * y + zz * z


def _composed(outer: _Placement, inner: _Placement) -> _Placement:
    """Return the placement of a frame within a placed one."""
    first, second, third = (_seen_direction(outer.axes, axis) for axis in inner.axes)
    return _Placement((first, second, third), _seen(outer, inner.origin))


def _chain(joints: Sequence[Element], places: Mapping[str, int]) -> _Chain:
    """Return the chain of a hand, with joints that do not move as parts of the placement of what hangs on them."""
    tip, moving = _Placement(((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)), _ORIGIN), list[_Joint]()
    for joint in joints:
        placement = _placement(joint)
        if joint.get("type") != "fixed":
            axis = _unit(_numbers(joint, "axis", "xyz", _ALONG_X))
            moving.append(_Joint(places[joint.get("name", "")], joint.get("type") == SLIDING, axis, placement))
        elif moving:
            moving[-1] = moving[-1]._replace(placement=_composed(placement, moving[-1].placement))
        else:
            tip = _composed(placement, tip)
    return _Chain(tip, tuple(moving))


def _placement(joint: Element) -> _Placement:
    """Return the origin of a joint: turned by roll about x, then pitch about y, then yaw about z of its parent."""
    (sr, sp, sy), (cr, cp, cy) = sine_and_cosine(_numbers(joint, "origin", "rpy", "0 0 0")).tolist()
    axes = (
        (cy * cp, sy * cp, -sp),
        (cy * sp * sr - sy * cr, sy * sp * sr + cy * cr, cp * sr),
        (cy * sp * cr + sy * sr, sy * sp * cr - cy * sr, cp * cr),
    )
    return _Placement(axes, _numbers(joint, "origin", "xyz", "0 0 0"))


def _unit(axis: _Vector) -> _Vector:
    """Return a vector at length 1; the square root is one of IEEE's operations."""
    x, y, z = axis
    length = math.sqrt(x * x + y * y + z * z)
    return x / length, y / length, z / length


def _numbers(joint: Element, tag: str, attribute: str, otherwise: str) -> _Vector:
    """Return three numbers of an element of a joint, or others where it has none."""
    element = joint.find(tag)
    x, y, z = map(float, (otherwise if element is None else element.get(attribute, otherwise)).split())
    return x, y, z


def _stacked(vectors: list[_Vector]) -> Floats:
    """Return vectors, one of each hand, as an array of shape (..., hands, 3)."""
    return np.moveaxis(np.array(vectors), (0, 1), (-2, -1))
