"""Distances of the hands from their targets (eq. 10 of the paper), for a learner, the teacher and a linear baseline."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from pipeline.arrays import Floats
from pipeline.robot.kinematics import Kinematics
from recorders.errors import ConfigError

WASHOUT_STEPS = 10
"""The first target is held this long before a test; ten steps bring the network as far as a full cycle does."""

_CM_PER_M = 100.0


class Predictor(Protocol):
    """Learner in the seeded state of a test, which can be evaluated."""

    def washout(self, u0: Floats, *, steps: int) -> None:
        """Hold one target [m], shape (6,), for some steps."""

    def predict(self, u: Floats) -> Floats:
        """Return outputs, shape (T, 21), for hand targets [m], shape (T, 6); nothing is learned."""


@dataclass(frozen=True)
class HandErrors:
    """Distances of both hands from their targets over a motion, in cm.

    `mean_cm` is eq. (10) with the 1/T that its text states: the mean over time and both hands. `left_cm` and `right_cm`
    are means over time, and what is called `max` is how far a hand, of both or of the one named, is off at most.
    """

    mean_cm: float
    max_cm: float
    left_cm: float
    right_cm: float
    left_max_cm: float
    right_max_cm: float
    samples: int

    @classmethod
    def of(cls, errors: Floats) -> "HandErrors":
        """Summarise errors [m], shape (T, 2), left then right.

        Raises
        ------
        ConfigError
            If they are no finite numbers: whatever was learned has diverged.
        """
        check_errors(errors)
        left, right = (errors.mean(axis=0) * _CM_PER_M).tolist()
        left_max, right_max = (errors.max(axis=0) * _CM_PER_M).tolist()
        return cls(
            mean_cm=float(errors.mean() * _CM_PER_M),
            max_cm=float(errors.max() * _CM_PER_M),
            left_cm=left,
            right_cm=right,
            left_max_cm=left_max,
            right_max_cm=right_max,
            samples=len(errors),
        )


def check_errors(errors: Floats) -> None:
    """Raise ConfigError if errors [m] are no finite numbers, as those of postures without measure are."""
    if not np.isfinite(errors).all():
        raise ConfigError("learning diverged: the hands' errors are no longer finite; lower the rates and ranges")


def hand_errors(kinematics: Kinematics, joints: Floats, targets: Floats) -> Floats:
    """Return the distance of each hand from its target.

    Parameters
    ----------
    kinematics : Kinematics
        Forward kinematics F of the robot.
    joints : ndarray, shape (T, n)
        Postures [rad or m].
    targets : ndarray, shape (T, 6)
        Positions asked for [m], left hand then right.

    Returns
    -------
    ndarray, shape (T, 2)
        ||F(q(t)) - x(t)|| [m], left then right: the terms of eq. (10); infinite where that is beyond all numbers.
    """
    reached = kinematics.hands_along(joints)  # (T, 2, 3)
    with np.errstate(over="ignore", invalid="ignore"):
        return np.asarray(np.linalg.norm(reached - targets.reshape(-1, 2, 3), axis=2))


def predicted_joints(predictor: Predictor, targets: Floats, joint_count: int) -> Floats:
    """Return the postures that a predictor answers a motion with, after the washout.

    Parameters
    ----------
    predictor : Predictor
        In the state that the test starts from.
    targets : ndarray, shape (T, 6)
        The motion [m].
    joint_count : int
        How many of the outputs, from the end, are joints.

    Returns
    -------
    ndarray, shape (T, joint_count)
    """
    predictor.washout(targets[0], steps=WASHOUT_STEPS)
    return predictor.predict(targets)[:, -joint_count:]


def linear_joints(targets: Floats, joints: Floats, *, asked: Floats) -> Floats:
    """Return the postures of the baseline: plain linear least squares from targets to joints.

    About the mean of the samples, and least in norm: it does not answer to a direction that they never show.

    Parameters
    ----------
    targets : ndarray, shape (T, 6)
        Of the samples that it is fitted to [m].
    joints : ndarray, shape (T, n)
        Of the same samples [rad or m].
    asked : ndarray, shape (S, 6)
        What it is to answer [m].

    Returns
    -------
    ndarray, shape (S, n)
    """
    centre, comfort = targets.mean(axis=0), joints.mean(axis=0)
    coefficients, *_ = np.linalg.lstsq(targets - centre, joints - comfort, rcond=None)  # (6, n)
    return np.asarray((asked - centre) @ coefficients + comfort)
