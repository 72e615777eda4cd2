"""Boxes of the hands: as wide as all hands reach together in any of their corners."""

from itertools import product

import numpy as np

from pipeline.arrays import Floats
from pipeline.collision.self_distance import CLEARANCE_M, SelfDistance
from pipeline.robot.config import RobotConfig
from pipeline.robot.coordinates import POSITION_SIZE, hand_slices, row_size, to_rows
from pipeline.robot.kinematics import Kinematics
from pipeline.teacher.teacher import REACH_BOUND_M, Teacher, approach
from recorders.errors import RobotError
from recorders.text.wording import hand_text

LEAST_M = 0.02
"""Half extent below which a box is of no use [m]."""

_REACH_M = 0.002  # distance from a corner at which a hand has reached it
_SHARE = 0.2  # of the reach: wider boxes take longer to learn
_LIMIT_MARGIN = 0.02  # of a joint's range, kept from its limits in every corner
_MM = 1000.0
_SIGNS = np.array(list(product((-1.0, 1.0), repeat=3)))  # (8, 3)


class BoxSearch:
    """Search for the largest box about the centres of a robot's hands, the same for each.

    In every corner the teacher reaches with all hands, with no joint at its limit, no part near another and no hand
    below the ground. Two hands are tried in any two of their corners, more in the same and in opposite ones. A hand
    whose pose is controlled is turned there, one way and the other.

    Parameters
    ----------
    robot : RobotConfig
        The robot, with its comfort posture and its centres; its boxes play no part.
    reach_only : bool
        Whether corners need be no more than within reach: explorations pass over what is too near to a part or a limit.
    """

    def __init__(self, robot: RobotConfig, *, reach_only: bool = False) -> None:
        self._robot = robot
        self._reach_only = reach_only
        self._teacher = Teacher(Kinematics(robot))
        self._distances = SelfDistance(robot)
        self._directions = _directions(len(robot.hands))
        self._turn_signs = (1.0,) if row_size(robot) == POSITION_SIZE else (1.0, -1.0)
        self._span = robot.upper - robot.lower
        self._bound_m = reach_bound_m(robot)

    def largest(self, radius_m: float) -> Floats:
        """Return the half extents (3,) [m], in whole millimetres, for hands that reach as far as `radius_m`.

        Raises
        ------
        RobotError
            Not even a box of `LEAST_M` is within reach.
        """
        most = int(_SHARE * radius_m * _MM)
        least = int(LEAST_M * _MM)
        if least > most or self.obstacle(np.full(3, LEAST_M)) is not None:
            reason = self.obstacle(np.full(3, LEAST_M)) or f"the reach is {radius_m:.2f} m"
            raise RobotError(
                f"robot '{self._robot.name}': found no box of {100 * LEAST_M:g} cm to all sides of its hands' centres: "
                f"{reason}"
            )
        box = np.full(3, self._widest([0, 1, 2], np.full(3, least), most))
        for axis in range(3):
            box[axis] = self._widest([axis], box, most)
        return box / _MM

    def obstacle(self, box: Floats) -> str | None:
        """Return what keeps the hands from a corner of a box with these half extents (3,) [m]; None if nothing does."""
        for directions in self._directions:
            for sign in self._turn_signs:
                if found := self._at(self._corner(directions, box, sign)):
                    return found
        return None

    def _corner(self, directions: Floats, box: Floats, sign: float) -> Floats:
        """Return the targets by row in one corner; hands whose pose is controlled are turned to a corner, too."""
        inputs = self._robot.input_centre.copy()
        extents = np.broadcast_to(box, directions.shape)
        for hand, where, direction, extent in zip(
            self._robot.hands, hand_slices(self._robot), directions, extents, strict=True
        ):
            inputs[where][:POSITION_SIZE] += direction * extent
            if hand.turn is not None:
                inputs[where][POSITION_SIZE:] += sign * direction * np.array(hand.turn)
        return to_rows(self._robot, inputs)

    def _widest(self, axes: list[int], box: Floats, most: int) -> int:
        """Return to how many millimetres some axes of a box can grow together."""
        low, high = int(box[axes[0]]), most + 1
        while high - low > 1:
            middle = (low + high) // 2
            grown = box.astype(np.float64)
            grown[axes] = middle
            low, high = (middle, high) if self.obstacle(grown / _MM) is None else (low, middle)
        return low

    def _at(self, targets: Floats) -> str | None:
        """Return what keeps the hands from targets by row; None if nothing does."""
        posture, short_m = approach(self._teacher, self._robot.comfort, targets, self._bound_m)
        if (worst := float(short_m.max())) > self._bound_m:
            hand = int(short_m.argmax())
            point = ", ".join(f"{value:.3f}" for value in targets[hand][:POSITION_SIZE])
            return f"{hand_text(self._robot.hand_names[hand])} stays {100 * worst:.1f} cm short of ({point}) m"
        return None if self._reach_only else self._too_near(targets, posture)

    def _too_near(self, targets: Floats, posture: Floats) -> str | None:
        """Return to what hands or joints come too near at targets by row, reached at a posture (n,)."""
        if (lowest := float(targets[:, 2].min())) < 0.0:
            return f"a corner is {-lowest:.2f} m below the ground"
        margins = np.minimum(posture - self._robot.lower, self._robot.upper - posture) / self._span
        if margins.min() < _LIMIT_MARGIN:
            return f"joint {self._robot.joints[int(margins.argmin())]} comes to its limit"
        distance_m, first, second = self._distances.nearest(posture)
        if distance_m < CLEARANCE_M:
            return f"{first} and {second} come as near as {100 * distance_m:.1f} cm"
        return None


def reach_bound_m(robot: RobotConfig) -> float:
    """Return the distance from a target at which a hand has reached it [m]: if a turn counts, as in explorations."""
    return _REACH_M if row_size(robot) == POSITION_SIZE else REACH_BOUND_M


def _directions(hands: int) -> list[Floats]:
    """Return the corners in which the hands are tried together, each (hands, 3) of -1 and 1."""
    if hands <= 2:
        return [np.array(corners) for corners in product(_SIGNS, repeat=hands)]
    alternating = np.where(np.arange(hands) % 2, -1.0, 1.0)[:, np.newaxis]
    return [turns * sign for sign in _SIGNS for turns in (np.ones((hands, 1)), alternating)]
