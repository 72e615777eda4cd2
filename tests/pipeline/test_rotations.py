"""Rotation vectors and quaternions are those of scipy, in both directions, and have bits of their own."""

import hashlib
import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

from pipeline.arrays import Floats
from pipeline.rotations import (
    great_arc,
    inverse,
    product,
    quaternions_of,
    quaternions_of_matrices,
    rotated,
    turns_between,
    vectors_of,
)

AXES = arrays(np.float64, 3, elements=st.floats(-1.0, 1.0))
ANGLES = st.one_of(st.floats(0.0, math.pi * (1.0 - 1e-9)), st.floats(0.0, 1e-6), st.just(0.0))
LENGTHS = st.floats(1e-3, 1e3)


def vector(axis: Floats, angle: float) -> Floats:
    """Return the rotation vector about an axis; one that is next to nothing gives way to z."""
    length = float(np.linalg.norm(axis))
    direction = axis / length if length > 1e-3 else np.array([0.0, 0.0, 1.0])
    turned: Floats = angle * direction
    return turned


@given(AXES, ANGLES)
def test_quaternions_are_those_of_scipy(axis: Floats, angle: float) -> None:
    found = quaternions_of(vector(axis, angle))
    expected = Rotation.from_rotvec(vector(axis, angle)).as_quat(canonical=True)
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=4e-16)


@given(AXES, ANGLES, LENGTHS, st.booleans())
def test_vectors_come_back_whatever_the_length_and_sign(axis: Floats, angle: float, length: float, minus: bool) -> None:
    turned = vector(axis, angle)
    quaternion = (-length if minus else length) * quaternions_of(turned)
    np.testing.assert_allclose(vectors_of(quaternion), turned, rtol=1e-14, atol=3e-15)
    np.testing.assert_allclose(
        vectors_of(quaternion), Rotation.from_quat(quaternion).as_rotvec(), rtol=1e-9, atol=4e-15
    )


@given(AXES, ANGLES)
def test_matrices_have_the_same_vectors(axis: Floats, angle: float) -> None:
    turned = vector(axis, angle)
    found = vectors_of(quaternions_of_matrices(Rotation.from_rotvec(turned).as_matrix()))
    np.testing.assert_allclose(found, turned, rtol=0.0, atol=3e-15)


@given(AXES, ANGLES, AXES)
def test_points_are_turned_as_by_scipy(axis: Floats, angle: float, point: Floats) -> None:
    turned = vector(axis, angle)
    expected = Rotation.from_rotvec(turned).apply(point)
    np.testing.assert_allclose(rotated(quaternions_of(turned), point), expected, rtol=0.0, atol=4e-15)


@given(AXES, ANGLES, AXES, ANGLES, st.floats(0.0, 1.0), st.booleans())
def test_a_part_of_the_great_arc_is_that_part_of_the_turn(
    axis: Floats, angle: float, other: Floats, further: float, fraction: float, minus: bool
) -> None:
    start, way = quaternions_of(vector(axis, angle)), min(further, 3.0)
    end = product(quaternions_of(vector(other, way)), start)
    found = great_arc(start, -end if minus else end, np.asarray(fraction))
    expected = product(quaternions_of(fraction * vector(other, way)), start)
    nearer = expected if float(expected @ found) >= 0.0 else -expected
    np.testing.assert_allclose(found, nearer, rtol=0.0, atol=1e-13)


@given(AXES, ANGLES, AXES, ANGLES)
def test_products_and_angles_are_those_of_scipy(axis: Floats, angle: float, other: Floats, further: float) -> None:
    first, second = vector(axis, angle), vector(other, further)
    p, q = (Rotation.from_rotvec(turned) for turned in (first, second))
    found = product(quaternions_of(first), quaternions_of(second))
    np.testing.assert_allclose(Rotation.from_quat(found).as_matrix(), (p * q).as_matrix(), rtol=0.0, atol=2e-15)
    np.testing.assert_allclose(turns_between(first, second), (p * q.inv()).magnitude(), rtol=0.0, atol=1e-7)
    back = product(found, inverse(quaternions_of(second)))
    np.testing.assert_allclose(back, quaternions_of(first), rtol=0.0, atol=1e-15)


def test_half_a_turn_and_none_have_vectors() -> None:
    np.testing.assert_array_equal(vectors_of([0.0, 0.0, 1.0, 0.0]), [0.0, 0.0, math.pi])
    np.testing.assert_array_equal(vectors_of([0.0, 0.0, 0.0, -1.0]), [0.0, 0.0, 0.0])
    np.testing.assert_array_equal(quaternions_of([0.0, 0.0, 0.0]), [0.0, 0.0, 0.0, 1.0])


def test_their_bits_are_these() -> None:
    """Every operation is one that IEEE 754 fixes, in an order that is fixed here."""
    grid = (np.arange(3 * 4096).reshape(-1, 3) % 997 - 498.0) / 300.0
    quaternions = quaternions_of(grid)
    content = np.concatenate([quaternions, vectors_of(quaternions), product(quaternions, quaternions[::-1])], axis=1)
    digest = hashlib.sha256(content.astype("<f8").tobytes()).hexdigest()
    assert digest[:16] == "3eebcc2a7b297853"
