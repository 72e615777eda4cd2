"""Errors of the hands: distances from their targets (eq. 10 of the paper), and turns where the pose is controlled."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Protocol

import numpy as np

from pipeline.arrays import Floats
from pipeline.robot.coordinates import positions_of, turns_of
from pipeline.robot.kinematics import Kinematics
from pipeline.rotations import turns_between
from recorders.errors import ConfigError

WASHOUT_STEPS = 10
"""The first target is held this long before a test; ten steps bring the network as far as a full cycle does."""

_CM_PER_M = 100.0
_NO_TURNS: Mapping[str, Floats] = MappingProxyType({})


class Predictor(Protocol):
    """Learner in the seeded state of a test, which can be evaluated."""

    def washout(self, u0: Floats, *, steps: int) -> None:
        """Hold one target, shape (inputs,), for some steps."""

    def predict(self, u: Floats) -> Floats:
        """Return outputs, shape (T, outputs), for targets, shape (T, inputs); nothing is learned."""


@dataclass(frozen=True)
class HandErrors:
    """Distances of the hands from their targets over a motion, in cm, and angles where the pose is controlled.

    Attributes
    ----------
    mean_cm : float
        Eq. (10) with the 1/T that its text states: the mean over time and hands.
    max_cm : float
        How far a hand is off at most.
    hands_cm, hands_max_cm : dict of str to float
        Mean over time and maximum of each hand, by its name, in the robot's order.
    samples : int
        How many.
    hands_deg, hands_max_deg : dict of str to float
        Mean over time and maximum of the angle between orientation and target [degrees], where the pose is controlled.
    """

    mean_cm: float
    max_cm: float
    hands_cm: dict[str, float]
    hands_max_cm: dict[str, float]
    samples: int
    hands_deg: dict[str, float] = field(default_factory=dict)
    hands_max_deg: dict[str, float] = field(default_factory=dict)

    @classmethod
    def of(cls, errors: Floats, hands: Sequence[str], turns: Mapping[str, Floats] = _NO_TURNS) -> "HandErrors":
        """Summarise errors [m] of some hands, shape (T, hands), and angles [rad], shape (T,), of some of them.

        Raises
        ------
        ConfigError
            If they are no finite numbers: whatever was learned has diverged.
        """
        check_errors(errors)
        return cls(
            mean_cm=float(errors.mean() * _CM_PER_M),
            max_cm=float(errors.max() * _CM_PER_M),
            hands_cm=dict(zip(hands, (errors.mean(axis=0) * _CM_PER_M).tolist(), strict=True)),
            hands_max_cm=dict(zip(hands, (errors.max(axis=0) * _CM_PER_M).tolist(), strict=True)),
            samples=len(errors),
            hands_deg={hand: float(np.degrees(angles.mean())) for hand, angles in turns.items()},
            hands_max_deg={hand: float(np.degrees(angles.max())) for hand, angles in turns.items()},
        )

    def to_dict(self) -> dict[str, float]:
        """Return the errors as JSON has them: of a hand `NAME_cm`, `NAME_max_cm`, `NAME_deg` and `NAME_max_deg`."""
        means = {f"{hand}_cm": error_cm for hand, error_cm in self.hands_cm.items()}
        worst = {f"{hand}_max_cm": error_cm for hand, error_cm in self.hands_max_cm.items()}
        turns = {f"{hand}_deg": angle for hand, angle in self.hands_deg.items()}
        turns |= {f"{hand}_max_deg": angle for hand, angle in self.hands_max_deg.items()}
        return {"mean_cm": self.mean_cm, "max_cm": self.max_cm, **means, **worst, **turns, "samples": self.samples}


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
    targets : ndarray, shape (T, inputs)
        What is asked for, hand by hand; the positions count [m].

    Returns
    -------
    ndarray, shape (T, hands)
        ||F(q(t)) - x(t)|| [m]: the terms of eq. (10); infinite where that is beyond all numbers.
    """
    reached = kinematics.hands_along(joints)  # (T, hands, 3)
    with np.errstate(over="ignore", invalid="ignore"):
        return np.asarray(np.linalg.norm(reached - positions_of(kinematics.robot, targets), axis=2))


def turn_errors(kinematics: Kinematics, joints: Floats, targets: Floats) -> dict[str, Floats]:
    """Return the angles [rad], shape (T,), between orientation and target, by hand whose pose is controlled.

    Parameters
    ----------
    kinematics : Kinematics
        Forward kinematics of the robot.
    joints : ndarray, shape (T, n)
        Postures [rad or m].
    targets : ndarray, shape (T, inputs)
        What is asked for, hand by hand.
    """
    if not (asked := turns_of(kinematics.robot, targets)):
        return {}
    reached = turns_of(kinematics.robot, kinematics.inputs_along(joints))
    return {hand: turns_between(reached[hand], turns) for hand, turns in asked.items()}


def posture_errors(kinematics: Kinematics, joints: Floats, targets: Floats) -> HandErrors:
    """Return the errors of postures (T, n) on targets (T, inputs); raises ConfigError as `HandErrors.of` does."""
    errors = hand_errors(kinematics, joints, targets)
    check_errors(errors)
    return HandErrors.of(errors, kinematics.robot.hand_names, turn_errors(kinematics, joints, targets))


def predicted_joints(predictor: Predictor, targets: Floats, joint_count: int) -> Floats:
    """Return the postures that a predictor answers a motion with, after the washout.

    Parameters
    ----------
    predictor : Predictor
        In the state that the test starts from.
    targets : ndarray, shape (T, inputs)
        The motion.
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
    targets : ndarray, shape (T, inputs)
        Of the samples that it is fitted to.
    joints : ndarray, shape (T, n)
        Of the same samples [rad or m].
    asked : ndarray, shape (S, inputs)
        What it is to answer.

    Returns
    -------
    ndarray, shape (S, n)
    """
    centre, comfort = targets.mean(axis=0), joints.mean(axis=0)
    coefficients, *_ = np.linalg.lstsq(targets - centre, joints - comfort, rcond=None)  # (inputs, n)
    return np.asarray((asked - centre) @ coefficients + comfort)
