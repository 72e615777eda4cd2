"""Comfort posture: where hands move freely in every direction, far from the limits of joints and above the ground."""

from collections.abc import Iterator

import numpy as np
from scipy.optimize import minimize

from pipeline.arrays import Floats
from pipeline.collision.self_distance import SelfDistance
from pipeline.robot.kinematics import Kinematics
from pipeline.robot_setup.reach import Reach, evenness_of, manipulability_of
from pipeline.robot_setup.statics import Statics
from recorders.errors import RobotError
from recorders.text.wording import hand_text

_STARTS = 8  # of the samples, the best: the search goes up from each
_ROOM = 0.1  # of a joint's range, kept from its limits
_MARGIN, _HEIGHT = 2.0, 0.2  # weights of joints' limits and of high elbows, beside the manipulability's
_GROUND = 0.25  # of the reach: height above the ground that hands keep
_BELOW = 100.0  # cost of a metre below the ground, squared
_LEAST = 1e-9  # of a manipulability, in parts of the largest
_CLEAR = 0.05  # of the reach, between parts of the robot


class Comfort:
    """Search for the comfort posture of a robot.

    The posture is the one of the greatest

        mean over hands of log(e w / w_max)  +  2 mean over joints of log(4 m (1 - m))  +  h / 5,

    where w is a hand's manipulability and e its evenness, m a joint's position in its range, from 0 to 1, and h the
    mean height of the joints in parts of the reach; hands below a quarter of the reach above the ground, and joints
    below it, cost the more the deeper they are.

    Parameters
    ----------
    kinematics : Kinematics
        Of the robot, whose own comfort posture plays no part.
    reach : Reach
        Samples of its reach.
    """

    def __init__(self, kinematics: Kinematics, reach: Reach) -> None:
        self._kinematics = kinematics
        self._reach = reach
        self._statics = Statics(kinematics.robot)
        self._largest = reach.manipulability.max(axis=0)  # (hands,)
        self._radius = float(reach.radii.mean())
        self._span = kinematics.upper - kinematics.lower

    def find(self) -> Floats:
        """Return the comfort posture (n,) [rad or m], rounded to two digits behind the point.

        Raises
        ------
        RobotError
            A hand cannot move in every direction anywhere, or the best postures bring the robot's parts together.
        """
        if not (self._largest > 0.0).all():
            hand = self._kinematics.robot.hand_names[int(self._largest.argmin())]
            raise RobotError(f"{hand_text(hand)}: expected joints that move it in three directions, found fewer")
        distances = SelfDistance(self._kinematics.robot)
        for posture in self._best():
            if distances.nearest(posture).distance_m >= _CLEAR * self._radius:
                return self._rounded(posture)
        raise RobotError(
            f"robot '{self._kinematics.robot.name}': found no posture in which its parts are "
            f"{100 * _CLEAR * self._radius:.1f} cm apart; narrow the joints with --limit, or make some rigid with --fix"
        )

    def cost(self, q: Floats) -> float:
        """Return what is to be least at posture `q` (n,)."""
        hands, jacobian = self._kinematics.hands_and_jacobian(q)
        part = (q - self._kinematics.lower) / self._span
        heights = self._statics.heights(q)
        parts = manipulability_of(jacobian) / self._largest * evenness_of(jacobian)
        freedom = np.log(np.maximum(parts, _LEAST)).mean()
        margin = np.log(np.maximum(4.0 * part * (1.0 - part), _LEAST)).mean()
        below = np.maximum(0.0, np.concatenate([_GROUND * self._radius - hands[:, 2], -heights]))
        gain = freedom + _MARGIN * margin + _HEIGHT * heights.mean() / self._radius
        return float(_BELOW * (below @ below) - gain)

    def _best(self) -> Iterator[Floats]:
        """Yield the postures to which the search leads from the best samples, the best first."""
        room = _ROOM * self._span
        bounds = np.stack([self._kinematics.lower + room, self._kinematics.upper - room], axis=1)
        costs = np.array([self.cost(posture) for posture in self._reach.postures])
        starts = self._reach.postures[np.argsort(costs, kind="stable")[:_STARTS]]
        found = [minimize(self.cost, start, method="SLSQP", bounds=bounds) for start in starts]
        for result in sorted(found, key=lambda result: float(result.fun)):
            yield result.x

    def _rounded(self, posture: Floats) -> Floats:
        """Round a posture where its joint's range is wide enough for that."""
        rounded = np.round(posture, 2)
        inside = (rounded > self._kinematics.lower) & (rounded < self._kinematics.upper) & (self._span > 0.2)
        found: Floats = np.where(inside, rounded + 0.0, np.round(posture, 4))
        return found
