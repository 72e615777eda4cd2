"""Rotation vectors and unit quaternions in a fixed order of IEEE operations: the same bits whatever libm there is.

A rotation vector r turns by |r| about its own direction; a quaternion is x, y, z, w, as ROS has it. Every rotation of
less than half a turn has one rotation vector, which depends on it smoothly. At half a turn there are two, r and -r:
`REGULAR_RAD` stays clear of that, and whoever takes rotations in refuses those beyond.
"""

import numpy as np
from numpy.typing import ArrayLike

from pipeline.arrays import Floats
from pipeline.trigonometry import cosine, sine

REGULAR_RAD = 2.6
"""Largest turn about a centre that is taken [rad]: 149 degrees; at 180 a rotation vector would jump."""

SHORTEST = 1e-6
"""A quaternion shorter than this has no direction, and is no rotation."""

_STRAIGHT_RAD = 1e-7  # the great arc between rotations nearer than this is a straight line, to the last bit
_QUARTER_TURN = float.fromhex("0x1.921fb54442d18p+0")
_HALVINGS = 3  # of an angle of at most an eighth of a turn, before its series
_ARC_TANGENT = [(-1) ** n / (2 * n + 1) for n in range(1, 10)]  # at a tangent of 0.099 the next term is below 1e-20


def quaternions_of(vectors: ArrayLike) -> Floats:
    """Return the unit quaternions of rotation vectors [rad], shape (..., 3); shape (..., 4).

    Examples
    --------
    >>> quaternions_of([0.0, 0.0, 1.0]).tolist()
    [0.0, 0.0, 0.479425538604203, 0.8775825618903728]
    """
    x, y, z = _parts(vectors)
    half = np.sqrt(x * x + y * y + z * z) / 2.0
    moves = half > 0.0
    factor = np.where(moves, sine(half) / np.where(moves, 2.0 * half, 1.0), 0.5)
    return np.stack([factor * x, factor * y, factor * z, cosine(half)], axis=-1)


def vectors_of(quaternions: ArrayLike) -> Floats:
    """Return the rotation vectors [rad] of quaternions of any length, shape (..., 4); shape (..., 3).

    Each is at most half a turn: a quaternion and its negative are one rotation.

    Examples
    --------
    >>> vectors_of([0.0, 0.0, 1.0, 1.0]).tolist()
    [0.0, 0.0, 1.5707963267948966]
    """
    x, y, z, w = _parts(quaternions)
    part = np.sqrt(x * x + y * y + z * z)  # sine of half the angle, times the length
    angle = 2.0 * _arc_tangent(part, np.abs(w))
    factor = np.where(part > 0.0, angle / np.where(part > 0.0, part, 1.0), 2.0)
    factor = np.where(w < 0.0, -factor, factor)
    return np.stack([factor * x, factor * y, factor * z], axis=-1)


def quaternions_of_matrices(matrices: ArrayLike) -> Floats:
    """Return quaternions, not of length 1, of rotation matrices, shape (..., 3, 3); shape (..., 4).

    Of four multiples of a quaternion, one for each of its parts, the one with the largest such part is taken.

    Source: S. W. Shepperd, "Quaternion from rotation matrix", J. Guidance and Control 1 (1978), doi:10.2514/3.55767b.

    Examples
    --------
    >>> quaternions_of_matrices([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]).tolist()
    [0.0, 0.0, 2.0, 2.0]
    """
    known = np.asarray(matrices, dtype=np.float64)
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = np.moveaxis(known, (-2, -1), (0, 1))
    multiples = np.stack(
        [
            np.stack([1.0 + xx - yy - zz, yx + xy, xz + zx, zy - yz], axis=-1),
            np.stack([yx + xy, 1.0 - xx + yy - zz, zy + yz, xz - zx], axis=-1),
            np.stack([xz + zx, zy + yz, 1.0 - xx - yy + zz, yx - xy], axis=-1),
            np.stack([zy - yz, xz - zx, yx - xy, 1.0 + xx + yy + zz], axis=-1),
        ],
        axis=-2,
    )
    largest = np.diagonal(multiples, axis1=-2, axis2=-1).argmax(axis=-1)
    taken: Floats = np.take_along_axis(multiples, largest[..., np.newaxis, np.newaxis], axis=-2)[..., 0, :]
    return taken


def product(first: ArrayLike, second: ArrayLike) -> Floats:
    """Return quaternions that turn by the `second` and then by the `first`, both of shape (..., 4)."""
    (a, b, c, d), (x, y, z, w) = _parts(first), _parts(second)
    return np.stack(
        [
            d * x + a * w + b * z - c * y,
            d * y - a * z + b * w + c * x,
            d * z + a * y - b * x + c * w,
            d * w - a * x - b * y - c * z,
        ],
        axis=-1,
    )


def unit(quaternions: Floats) -> Floats:
    """Return quaternions, shape (..., 4), with length 1."""
    return quaternions / length(quaternions)[..., np.newaxis]


def length(quaternions: Floats) -> Floats:
    """Return the lengths of quaternions, shape (..., 4), as (...)."""
    return np.asarray(np.sqrt(_dot(quaternions, quaternions)))


def rotated(quaternions: Floats, points: Floats) -> Floats:
    """Return points [m], shape (..., 3), turned by unit quaternions, shape (..., 4)."""
    (x, y, z, w), (px, py, pz) = _parts(quaternions), _parts(points)
    tx, ty, tz = 2.0 * (y * pz - z * py), 2.0 * (z * px - x * pz), 2.0 * (x * py - y * px)
    return np.stack(
        [
            (px + w * tx) + (y * tz - z * ty),
            (py + w * ty) + (z * tx - x * tz),
            (pz + w * tz) + (x * ty - y * tx),
        ],
        axis=-1,
    )


def great_arc(start: Floats, end: Floats, fraction: Floats) -> Floats:
    """Return rotations on the shorter great arc between two (slerp: K. Shoemake, 1985, DOI 10.1145/325165.325242).

    Parameters
    ----------
    start, end : ndarray, shape (..., 4)
        Unit quaternions.
    fraction : ndarray, shape (...)
        How much of the way is gone, from 0 to 1.

    Returns
    -------
    ndarray, shape (..., 4)
        Unit quaternions.
    """
    near = np.where((_dot(start, end) < 0.0)[..., np.newaxis], -end, end)
    # The angle between the two from chord and sum, which is exact near 0: at most a quarter of a turn.
    angle = 2.0 * _arc_tangent(length(near - start), length(near + start))
    straight = angle < _STRAIGHT_RAD
    whole = sine(np.where(straight, 1.0, angle))
    gone = np.where(straight, fraction, sine(fraction * angle) / whole)
    left = np.where(straight, 1.0 - fraction, sine((1.0 - fraction) * angle) / whole)
    return unit(left[..., np.newaxis] * start + gone[..., np.newaxis] * near)


def inverse(quaternions: ArrayLike) -> Floats:
    """Return the quaternions that turn back, shape (..., 4)."""
    turned_back: Floats = np.asarray(quaternions, dtype=np.float64) * np.array([-1.0, -1.0, -1.0, 1.0])
    return turned_back


def turns_between(vectors: ArrayLike, others: ArrayLike) -> Floats:
    """Return the angles [rad] between orientations whose rotation vectors have one centre, (..., 3) each; (...)."""
    x, y, z = _parts(vectors_of(product(quaternions_of(vectors), inverse(quaternions_of(others)))))
    angles: Floats = np.sqrt(x * x + y * y + z * z)
    return angles


def _parts(values: ArrayLike) -> list[Floats]:
    array = np.asarray(values, dtype=np.float64)
    return [array[..., part] for part in range(array.shape[-1])]


def _dot(some: Floats, others: Floats) -> Floats:
    """Return the sums of products of quaternions, shape (..., 4) each, as (...)."""
    (ax, ay, az, aw), (bx, by, bz, bw) = _parts(some), _parts(others)
    return np.asarray(ax * bx + ay * by + az * bz + aw * bw)


def _arc_tangent(sines: Floats, cosines: Floats) -> Floats:
    """Return the angles [rad] from 0 to a quarter turn whose tangents are quotients of numbers from 0 up.

    atan t = 2 atan(t / (1 + sqrt(1 + t^2))) halves an angle until its Taylor series is short.
    """
    steep = sines > cosines
    larger, smaller = np.where(steep, sines, cosines), np.where(steep, cosines, sines)
    tangent = smaller / np.where(larger > 0.0, larger, 1.0)
    for _ in range(_HALVINGS):
        tangent = tangent / (1.0 + np.sqrt(1.0 + tangent * tangent))
    squared, total = tangent * tangent, np.zeros_like(tangent)
    for coefficient in reversed(_ARC_TANGENT):
        total = (total + coefficient) * squared
    angle = (tangent + tangent * total) * 2.0**_HALVINGS
    return np.where(steep, _QUARTER_TURN - angle, angle)
