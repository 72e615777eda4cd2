"""Reach of a robot's hands: positions and manipulability at postures that fill the joints' ranges evenly."""

from dataclasses import dataclass

import numpy as np
from scipy.stats import qmc

from pipeline.arrays import Floats
from pipeline.robot.kinematics import Kinematics

SAMPLES = 4096
"""Postures that are tried: a power of two, as Sobol's sequence is even for these."""


@dataclass(frozen=True, eq=False)
class Reach:
    """Samples of a robot's reach, from the first on ever denser.

    Attributes
    ----------
    postures : ndarray
        Postures [rad or m], shape (N, n).
    hands : ndarray
        Positions of the hands [m], world frame, shape (N, hands, 3).
    manipulability : ndarray
        Of each hand [m^3], shape (N, hands).
    """

    postures: Floats
    hands: Floats
    manipulability: Floats

    @property
    def radii(self) -> Floats:
        """Half of the largest extent of each hand's reach [m], shape (hands,)."""
        extents = self.hands.max(axis=0) - self.hands.min(axis=0)  # (hands, 3)
        radii: Floats = extents.max(axis=1) / 2.0
        return radii


def sample_reach(kinematics: Kinematics, *, seed: int, samples: int = SAMPLES) -> Reach:
    """Sample the reach of a robot's hands by a scrambled Sobol sequence over the ranges of its joints.

    Parameters
    ----------
    kinematics : Kinematics
        Of the robot.
    seed : int
        Seed of the scrambling.
    samples : int
        Number of postures, a power of two.
    """
    unit = qmc.Sobol(d=len(kinematics.lower), scramble=True, rng=np.random.default_rng(seed)).random(samples)
    postures = qmc.scale(unit, kinematics.lower, kinematics.upper)
    hands, manipulability = [], []
    for posture in postures:
        positions, jacobian = kinematics.hands_and_jacobian(posture)
        hands.append(positions)
        manipulability.append(manipulability_of(jacobian))
    return Reach(postures, np.array(hands), np.array(manipulability))


def manipulability_of(jacobian: Floats) -> Floats:
    """Return the manipulability of each hand, the root of det(J J^T), for a Jacobian (3 hands, n); shape (hands,).

    Source: T. Yoshikawa, "Manipulability of robotic mechanisms", 1985, doi:10.1177/027836498500400201.
    """
    squares = _squares(jacobian)
    volumes: Floats = np.sqrt(np.maximum(np.linalg.det(squares), 0.0))
    return volumes


def evenness_of(jacobian: Floats) -> Floats:
    """Return how evenly each hand moves in all directions, for a Jacobian (3 hands, n): 0 to 1, shape (hands,).

    It is the geometric mean of the squared axes of the manipulability ellipsoid over their arithmetic mean.

    Source: J.-O. Kim, P. K. Khosla, "Dexterity measures for design and control of manipulators", 1991,
    doi:10.1109/IROS.1991.174572.
    """
    squares = _squares(jacobian)
    means = np.maximum(np.trace(squares, axis1=1, axis2=2) / 3.0, np.finfo(np.float64).tiny)
    even: Floats = np.cbrt(np.maximum(np.linalg.det(squares), 0.0)) / means
    return even


def _squares(jacobian: Floats) -> Floats:
    """J J^T of each hand's rows of a Jacobian (3 hands, n), shape (hands, 3, 3)."""
    each = jacobian.reshape(-1, 3, jacobian.shape[1])
    squares: Floats = each @ each.transpose(0, 2, 1)
    return squares
