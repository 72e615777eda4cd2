"""Rotations as unit quaternions (x, y, z, w), many at a time: every operation element by element, none of libm's."""

import numpy as np

from pipeline.arrays import Floats
from pipeline.trigonometry import sine

SHORTEST = 1e-6
"""A quaternion shorter than this has no direction, and is no rotation."""

_STRAIGHT_RAD = 1e-7  # the great arc between rotations nearer than this is a straight line, to the last bit
_HALVINGS = 3  # of an angle of at most an eighth of a turn, before its series
_ARC_TANGENT = [(-1) ** n / (2 * n + 1) for n in range(1, 10)]  # at a tangent of 0.099 the next term is below 1e-20


def unit(q: Floats) -> Floats:
    """Return quaternions, shape (n, 4), with length 1."""
    return q / length(q)[:, None]


def length(q: Floats) -> Floats:
    """Return the lengths of quaternions, shape (n, 4), as (n,)."""
    total = _dot(q, q)
    return np.asarray(np.sqrt(total))


def product(second: Floats, first: Floats) -> Floats:
    """Return the rotations that turn by the first and then by the second, shape (n, 4) each."""
    (ax, ay, az, aw), (bx, by, bz, bw) = second.T, first.T
    return np.stack(
        (
            ((aw * bx + ax * bw) + ay * bz) - az * by,
            ((aw * by - ax * bz) + ay * bw) + az * bx,
            ((aw * bz + ax * by) - ay * bx) + az * bw,
            ((aw * bw - ax * bx) - ay * by) - az * bz,
        ),
        axis=1,
    )


def rotated(q: Floats, points: Floats) -> Floats:
    """Return points [m], shape (n, 3), turned by unit quaternions, shape (n, 4)."""
    (x, y, z, w), (px, py, pz) = q.T, points.T
    tx, ty, tz = 2.0 * (y * pz - z * py), 2.0 * (z * px - x * pz), 2.0 * (x * py - y * px)
    return np.stack(
        (
            (px + w * tx) + (y * tz - z * ty),
            (py + w * ty) + (z * tx - x * tz),
            (pz + w * tz) + (x * ty - y * tx),
        ),
        axis=1,
    )


def great_arc(start: Floats, end: Floats, fraction: Floats) -> Floats:
    """Return rotations on the shorter great arc between two (slerp: K. Shoemake, 1985, DOI 10.1145/325165.325242).

    Parameters
    ----------
    start, end : ndarray, shape (n, 4)
        Unit quaternions.
    fraction : ndarray, shape (n,)
        How much of the way is gone, from 0 to 1.

    Returns
    -------
    ndarray, shape (n, 4)
        Unit quaternions.
    """
    near = np.where((_dot(start, end) < 0.0)[:, None], -end, end)
    # The angle between the two from chord and sum, which is exact near 0: at most a quarter of a turn.
    angle = 2.0 * _arc_tangent(length(near - start) / length(near + start))
    straight = angle < _STRAIGHT_RAD
    whole = sine(np.where(straight, 1.0, angle))
    gone = np.where(straight, fraction, sine(fraction * angle) / whole)
    left = np.where(straight, 1.0 - fraction, sine((1.0 - fraction) * angle) / whole)
    return unit(left[:, None] * start + gone[:, None] * near)


def _dot(a: Floats, b: Floats) -> Floats:
    (ax, ay, az, aw), (bx, by, bz, bw) = a.T, b.T
    total: Floats = ((ax * bx + ay * by) + az * bz) + aw * bw
    return total


def _arc_tangent(tangent: Floats) -> Floats:
    """Return the angles [rad] of tangents from 0 to 1; atan t = 2 atan(t / (1 + sqrt(1 + t^2))) shortens the series."""
    for _ in range(_HALVINGS):
        tangent = tangent / (1.0 + np.sqrt(1.0 + tangent * tangent))
    squared, total = tangent * tangent, np.zeros_like(tangent)
    for coefficient in reversed(_ARC_TANGENT):
        total = (total + coefficient) * squared
    return (tangent + tangent * total) * 2.0**_HALVINGS
