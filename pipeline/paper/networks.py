"""Networks that learned a pattern, tried on every motion, beside linear least squares on what they learned from."""

from collections.abc import Mapping, Sequence

import numpy as np

from pipeline.arrays import Floats
from pipeline.evaluation.errors import HandErrors, linear_joints, posture_errors
from pipeline.evaluation.trials import Trial, evaluate_samples
from pipeline.paper.results import NetworkEnsemble
from pipeline.robot.kinematics import Kinematics
from pipeline.samples.pairs import Samples
from pipeline.training.batch import Outcome


def try_networks(
    pattern: str, outcomes: Sequence[Outcome], *, seeds: tuple[int, ...], samples: Mapping[str, Samples]
) -> NetworkEnsemble:
    """Try networks on motions.

    Parameters
    ----------
    pattern : str
        Name of the motion that they learned; `samples` holds it.
    outcomes : sequence of Outcome
        What each training came to.
    seeds : tuple of int
        Of the trainings, in the same order.
    samples : mapping of str to Samples
        The motions, recorded, by name.

    Raises
    ------
    ControllerError
        If a motion was recorded with a robot of other joints.
    """
    controllers = tuple(outcome.controller for outcome in outcomes)
    trials = {
        name: tuple(evaluate_samples(controller, motion, name=name) for controller in controllers)
        for name, motion in samples.items()
    }
    return NetworkEnsemble(
        pattern=pattern,
        seeds=seeds,
        curves_cm=np.array([outcome.errors_cm for outcome in outcomes]),
        controllers=controllers,
        trials=trials,
        linear={name: _linear_errors(samples[pattern], motion.targets) for name, motion in samples.items()},
        from_recorded_cm=np.array([_from_recorded_cm(trial, samples[pattern]) for trial in trials[pattern]]),
    )


def _from_recorded_cm(trial: Trial, recorded: Samples) -> float:
    hands = Kinematics(recorded.robot).hands_along(recorded.joints)  # (T, 2, 3)
    return 100.0 * float(np.linalg.norm(trial.reached - hands, axis=2).mean())


def _linear_errors(learned: Samples, targets: Floats) -> HandErrors:
    """Errors on a motion of the baseline, linear least squares fitted to what a network learned from."""
    answers = linear_joints(learned.targets, learned.joints, asked=targets)
    return posture_errors(Kinematics(learned.robot), answers, targets)
