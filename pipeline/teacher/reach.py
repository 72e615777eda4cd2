"""Reach: samples of a motion that the robot cannot reach, and their treatment."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.arrays import Floats
from pipeline.motions.motion import Motion
from pipeline.robot.coordinates import hand_slices, to_inputs, to_rows
from pipeline.robot.kinematics import Kinematics
from pipeline.teacher.teacher import REACH_BOUND_M, Teacher, approach, check_reach, misses_m
from recorders.errors import MotionError

CHOICES = ("refuse", "clip", "skip", "keep")
"""Treatments of samples out of reach: refuse the motion; move them to the nearest point within reach; leave them out,
the target before them being held on; keep them, for the teacher to come as near as it does."""

_STEPS = 100  # of the search for the nearest point; 30 come within 2 mm of where it ends
_PRIORITY = 10.0  # of a hand that reaches its target: it then stays within a hundredth of what the other lacks
_START_DAMPING, _LEAST_DAMPING = 1e-2, 1e-5
_EASE, _TIGHTEN = 1 / 3, 4.0  # of the damping, after a step that helps and one that does not


class Miss(NamedTuple):
    """A sample that a hand does not reach.

    Attributes
    ----------
    sample : int
        Index of the sample.
    short_m : ndarray
        What each hand misses its target by [m], see `teacher.misses_m`, shape (hands,).
    """

    sample: int
    short_m: Floats


@dataclass(frozen=True)
class OutOfReach:
    """Samples of a motion that were out of reach.

    Attributes
    ----------
    handled : str
        One of `CHOICES`.
    samples : int
        How many of the samples.
    first_s : float or None
        Time of the first of them [s]; None if there is none.
    hand, worst_cm : str or None and float or None
        The hand that was farthest from its target, and how far it stayed [cm]; None if there is none.
    """

    handled: str
    samples: int = 0
    first_s: float | None = None
    hand: str | None = None
    worst_cm: float | None = None


def bring_within_reach(teacher: Teacher, motion: Motion, *, choice: str) -> tuple[Motion, OutOfReach]:
    """Return the motion with its samples out of reach treated as chosen, and what there was to treat.

    Parameters
    ----------
    teacher : Teacher
        Decides what is within reach: what it reaches to `REACH_BOUND_M`.
    motion : Motion
        What is asked for.
    choice : str
        One of `CHOICES`.

    Raises
    ------
    MotionError
        The choice is unknown; samples are out of reach and the choice is to refuse, or fewer than two are left.
    """
    if choice not in CHOICES:
        raise MotionError(f"samples out of reach: expected one of {', '.join(CHOICES)}, found '{choice}'")
    if choice == "refuse":
        _check(teacher, motion)
        return motion, OutOfReach(choice)
    misses = list(find_misses(teacher, motion.targets))
    if not misses:
        return motion, OutOfReach(choice)
    found = _summary(motion, misses, choice, teacher.kinematics.robot.hand_names)
    if choice == "clip":
        return _clipped(teacher, motion, misses), found
    return (_without(motion, misses) if choice == "skip" else motion), found


def find_misses(teacher: Teacher, targets: ArrayLike) -> Iterator[Miss]:
    """Yield every one of the `targets`, by row (T, hands, 3 or 7), that a hand does not reach.

    The teacher runs along the targets kinematically; after one that it does not reach it goes on from the last that it
    did.
    """
    q = teacher.kinematics.robot.comfort
    for sample, target in enumerate(np.asarray(targets, dtype=np.float64)):
        reached, short_m = approach(teacher, q, target)
        if short_m.max() > REACH_BOUND_M:
            yield Miss(sample, short_m)
        else:
            q = reached


def nearest_hands(kinematics: Kinematics, targets: Floats, *, missing: NDArray[np.bool_]) -> Floats:
    """Return hands by row that the joints allow, (hands, 3 or 7), those of the `missing` hands as near as can be.

    The posture is sought from the comfort posture on by Levenberg-Marquardt steps. Each joint is its range's middle
    plus half the range times the sine of a free variable, so that it never leaves its limits.

    Parameters
    ----------
    kinematics : Kinematics
        Of the robot.
    targets : array, shape (hands, 3 or 7)
        What is asked of the hands, by row.
    missing : array of bool, shape (hands,)
        Whether each hand fails to reach its target; one that does not keeps to it.
    """
    robot, goal = kinematics.robot, to_inputs(kinematics.robot, targets)
    sizes = [len(goal[rows]) for rows in hand_slices(robot)]
    weights = np.repeat(np.where(missing, 1.0, _PRIORITY), sizes)  # (inputs,)
    middle, half = (kinematics.upper + kinematics.lower) / 2, (kinematics.upper - kinematics.lower) / 2

    def linearised(angles: Floats) -> tuple[Floats, Floats]:
        """Weighted residual (inputs,), and its Jacobian with respect to the angles, less the sign, (inputs, n)."""
        hands, jacobian = kinematics.inputs_and_jacobian(middle + half * np.sin(angles))
        return weights * (goal - hands), weights[:, None] * jacobian * (half * np.cos(angles))

    angles: Floats = np.arcsin((kinematics.robot.comfort - middle) / half)
    residual, slope = linearised(angles)
    damping = _START_DAMPING
    for _ in range(_STEPS):
        step = slope.T @ np.linalg.solve(slope @ slope.T + damping * np.eye(len(weights)), residual)
        ahead, ahead_slope = linearised(angles + step)
        if ahead @ ahead < residual @ residual:
            angles, residual, slope = angles + step, ahead, ahead_slope
            damping = max(damping * _EASE, _LEAST_DAMPING)
        else:
            damping *= _TIGHTEN
    return to_rows(robot, kinematics.inputs(middle + half * np.sin(angles)))


def _check(teacher: Teacher, motion: Motion) -> None:
    try:
        check_reach(teacher, motion)
    except MotionError as error:
        raise MotionError(f"{error}; make it smaller, or choose to clip, skip or keep such samples") from None


def _summary(motion: Motion, misses: list[Miss], choice: str, hands: Sequence[str]) -> OutOfReach:
    short_m = np.array([miss.short_m for miss in misses])  # (misses, hands)
    hand = int(short_m.max(axis=0).argmax())
    return OutOfReach(
        handled=choice,
        samples=len(misses),
        first_s=float(motion.times_s[misses[0].sample]),
        hand=hands[hand],
        worst_cm=100.0 * float(short_m.max()),
    )


def _clipped(teacher: Teacher, motion: Motion, misses: list[Miss]) -> Motion:
    targets = motion.targets.copy()
    for sample, short_m in misses:
        targets[sample] = _clip(teacher.kinematics, targets[sample], worst=int(short_m.argmax()))
    return Motion(motion.name, motion.times_s, targets, closed=motion.closed)


def _clip(kinematics: Kinematics, target: Floats, *, worst: int) -> Floats:
    """Bring the worst hand as near its target as it goes; the others too, if one cannot keep to its own meanwhile."""
    missing = np.arange(len(target)) == worst
    nearest = nearest_hands(kinematics, target, missing=missing)
    if misses_m(kinematics.robot, nearest, target).max(where=~missing, initial=0.0) > REACH_BOUND_M:
        missing[:] = True
        nearest = nearest_hands(kinematics, target, missing=missing)
    return np.where(missing[:, None], np.round(nearest, 9), target)


def _without(motion: Motion, misses: list[Miss]) -> Motion:
    within = np.ones(len(motion), dtype=np.bool_)
    within[[miss.sample for miss in misses]] = False
    if within.sum() < 2:
        raise MotionError(
            f"motion '{motion.name}': expected at least two samples within reach, "
            f"found {int(within.sum())} of {len(motion)}"
        )
    return Motion(motion.name, motion.times_s[within], motion.targets[within], closed=motion.closed)
