"""Rows and inputs: hand targets as messages and motions have them, and the numbers that a learner knows them by.

A row is a hand's position [m] and, in a robot with a hand whose pose is controlled, its orientation as a quaternion
x, y, z, w. Inputs are three numbers for each hand [m], and three more where its pose is controlled: its turn [rad], as
the rotation vector in the axes of the world from its orientation in the middle. A hand of which only the position is
controlled has the identity as its orientation, and what is measured or asked of it counts for nothing.
"""

from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from pipeline.arrays import Floats
from pipeline.robot.config import RobotConfig
from pipeline.robot.hands import Hand
from pipeline.rotations import inverse, product, quaternions_of, vectors_of

POSITION_SIZE, TURN_SIZE, ROW_SIZE = 3, 3, 7

_NO_TURN = (0.0, 0.0, 0.0, 1.0)


def row_size(robot: RobotConfig) -> int:
    """Return how many numbers a row has: 3, or 7 if the pose of any hand is controlled."""
    return POSITION_SIZE if all(hand.orientation is None for hand in robot.hands) else ROW_SIZE


def hand_slices(robot: RobotConfig) -> list[slice]:
    """Return where each hand's numbers are among the inputs."""
    sizes = [POSITION_SIZE if hand.orientation is None else POSITION_SIZE + TURN_SIZE for hand in robot.hands]
    return [slice(start, end) for start, end in pairwise(np.cumsum([0, *sizes]).tolist())]


def centre_rows(robot: RobotConfig) -> Floats:
    """Return the middle of every hand, shape (hands, row size)."""
    rows = [(*hand.centre, *(hand.orientation or _NO_TURN)) for hand in robot.hands]
    return np.array(rows)[:, : row_size(robot)]


def to_inputs(robot: RobotConfig, rows: ArrayLike) -> Floats:
    """Return the inputs, shape (..., inputs), of the rows of all hands, shape (..., hands, row size)."""
    known = np.asarray(rows, dtype=np.float64)
    if row_size(robot) == POSITION_SIZE:
        return known.reshape(*known.shape[:-2], -1)
    parts = []
    for place, hand in enumerate(robot.hands):
        parts.append(known[..., place, :POSITION_SIZE])
        if hand.orientation is not None:
            parts.append(turn_of(hand, known[..., place, POSITION_SIZE:]))
    return np.concatenate(parts, axis=-1)


def to_rows(robot: RobotConfig, inputs: ArrayLike) -> Floats:
    """Return the rows of all hands, shape (..., hands, row size), of inputs, shape (..., inputs)."""
    known = np.asarray(inputs, dtype=np.float64)
    if row_size(robot) == POSITION_SIZE:
        return known.reshape(*known.shape[:-1], len(robot.hands), POSITION_SIZE)
    rows = np.empty((*known.shape[:-1], len(robot.hands), ROW_SIZE))
    rows[..., POSITION_SIZE:] = _NO_TURN
    for place, (hand, where) in enumerate(zip(robot.hands, hand_slices(robot), strict=True)):
        rows[..., place, :POSITION_SIZE] = known[..., where][..., :POSITION_SIZE]
        if hand.orientation is not None:
            turned = quaternions_of(known[..., where][..., POSITION_SIZE:])
            rows[..., place, POSITION_SIZE:] = product(turned, hand.orientation)
    return rows


def positions_of(robot: RobotConfig, inputs: ArrayLike) -> Floats:
    """Return the positions of all hands [m], shape (..., hands, 3), of inputs, shape (..., inputs)."""
    known = np.asarray(inputs, dtype=np.float64)
    return np.stack([known[..., where][..., :POSITION_SIZE] for where in hand_slices(robot)], axis=-2)


def turns_of(robot: RobotConfig, inputs: ArrayLike) -> dict[str, Floats]:
    """Return the turns [rad], shape (..., 3), of inputs, shape (..., inputs), by hand whose pose is controlled."""
    known = np.asarray(inputs, dtype=np.float64)
    slices = zip(robot.hands, hand_slices(robot), strict=True)
    return {hand.name: known[..., where][..., POSITION_SIZE:] for hand, where in slices if hand.orientation is not None}


def turn_of(hand: Hand, orientations: ArrayLike) -> Floats:
    """Return the turns [rad], shape (..., 3), of orientations of a hand whose pose is controlled, shape (..., 4)."""
    return vectors_of(product(orientations, inverse(hand.orientation or _NO_TURN)))


def with_orientations(robot: RobotConfig, targets: Floats) -> Floats:
    """Return targets of all hands as rows: positions alone, shape (T, hands, 3), get the orientations of the middle."""
    if targets.shape[-1] == row_size(robot):
        return targets
    middle = np.broadcast_to(centre_rows(robot)[:, POSITION_SIZE:], (len(targets), len(robot.hands), 4))
    return np.concatenate([targets, middle], axis=-1)
