"""Orientations that people show, as turns of a hand from its middle: smoothed, resampled and placed with scipy."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from pipeline.arrays import Floats
from pipeline.motions.smoothing import resampled, smoothed
from pipeline.robot.config import RobotConfig
from pipeline.robot.hands import Quaternion
from pipeline.rotations import REGULAR_RAD, SHORTEST
from recorders.errors import MotionError


def are_orientations(quaternions: Floats) -> NDArray[np.bool_]:
    """Return which quaternions x, y, z, w, shape (N, 4), are an orientation: finite, and of some length."""
    finite = np.asarray(np.isfinite(quaternions).all(axis=1))
    lengths = np.linalg.norm(np.where(finite[:, None], quaternions, 0.0), axis=1)
    return np.asarray(finite & (lengths >= SHORTEST))


def shown_turns(
    times_s: Floats,
    quaternions: Floats,
    at_s: Floats,
    *,
    window_s: float,
    axes: Floats,
    middle: Quaternion,
    centred: bool,
) -> Floats:
    """Return turns [rad] of a hand from its orientation in the middle, in the axes of the world, shape (T, 3).

    Parameters
    ----------
    times_s : ndarray, shape (N,)
        Rising times [s].
    quaternions : ndarray, shape (N, 4)
        Orientations there, x, y, z, w, in the axes of the source.
    at_s : ndarray, shape (T,)
        Times that are wanted [s], within these.
    window_s : float
        Window in which rotation vectors about the mean orientation are smoothed [s]; 0 takes great arcs between the
        orientations.
    axes : ndarray, shape (3, 3)
        Axes of the source, by column, in the world.
    middle : Quaternion
        Orientation of the hand in the middle.
    centred : bool
        Whether the mean of what is shown becomes the middle; else orientations are in the world as they are.

    Raises
    ------
    MotionError
        If they turn farther about their mean than rotation vectors are regular.
    """
    shown = Rotation.from_quat(quaternions)
    mean = shown.mean()
    about = shown * mean.inv()
    if (most := float(about.magnitude().max())) > REGULAR_RAD:
        raise MotionError(
            f"expected orientations within {np.degrees(REGULAR_RAD):.0f} degrees of their mean, found one "
            f"{np.degrees(most):.0f} from it"
        )
    if window_s:
        even_s, vectors, _ = smoothed(times_s, about.as_rotvec(), window_s)
        found = Rotation.from_rotvec(resampled(even_s, vectors, at_s))
    else:
        found = Slerp(times_s, about)(at_s)
    source = Rotation.from_matrix(axes)
    in_world = source * found * source.inv() if centred else source * found * mean * Rotation.from_quat(middle).inv()
    turns: Floats = in_world.as_rotvec()
    return turns


def inputs_of(robot: RobotConfig, positions: Sequence[Floats], turns: Mapping[str, Floats]) -> Floats:
    """Return inputs of positions (T, 3) of all hands, and turns of some; others whose pose is controlled have none."""
    parts = []
    for hand, points in zip(robot.hands, positions, strict=True):
        parts.append(points)
        if hand.orientation is not None:
            parts.append(turns.get(hand.name, np.zeros_like(points)))
    return np.concatenate(parts, axis=1)
