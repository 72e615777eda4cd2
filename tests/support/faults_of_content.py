"""Faults that show only where a case has the content for it: each is planted in the shipped case that does."""

from pathlib import Path
from typing import Any, NamedTuple

from faults import Patch, rewrite

from pipeline.evaluation import errors
from pipeline.learner.rules.reservoir import kernels, learner
from pipeline.resources import data_path
from pipeline.training import run as learning_run
from recorders.ticks.joiner import JointMap


class ContentFault(NamedTuple):
    """A fault, the case that sees it, and where it shows."""

    name: str
    plant: Any
    case: str
    field: str
    note: str = ""


def no_feedback_error(patch: Patch) -> None:
    patch.setattr(kernels, "add_feedback_error", lambda *arguments: None)


def feedback_error_of_another_sign(patch: Patch) -> None:
    rewrite(patch, kernels, "add_feedback_error", "views.gamma[i] +=", "views.gamma[i] -=")


def a_step_less_of_washout(patch: Patch) -> None:
    patch.setattr(errors, "WASHOUT_STEPS", errors.WASHOUT_STEPS - 1)


def a_step_more_of_washout(patch: Patch) -> None:
    patch.setattr(errors, "WASHOUT_STEPS", errors.WASHOUT_STEPS + 1)


def another_seed_of_the_washout(patch: Patch) -> None:
    rewrite(patch, learner.Learner, "washout", '"washout"', "0")


def joints_by_place(patch: Patch) -> None:
    patch.setattr(JointMap, "positions", lambda self, joints: joints.position[: len(self.names)])


def hands_swapped_in_trials(patch: Patch) -> None:
    right = errors.hand_errors
    patch.setattr(errors, "hand_errors", lambda *arguments: right(*arguments)[:, ::-1])


def hands_swapped_in_cycles(patch: Patch) -> None:
    rewrite(patch, learning_run.LearningRun, "_end_presentation", "mean(axis=0)", "mean(axis=0)[::-1]")


_WHOLE = "of the whole run"
CONTENT_FAULTS = (
    ContentFault("no feedback error", no_feedback_error, "feedback", "state"),
    ContentFault("feedback error negated", feedback_error_of_another_sign, "feedback", "state"),
    ContentFault("washout shorter", a_step_less_of_washout, "feedback", "trials_cm", _WHOLE),
    ContentFault("washout longer", a_step_more_of_washout, "feedback", "trials_cm", _WHOLE),
    ContentFault("seed of the washout", another_seed_of_the_washout, "feedback", "trials_cm", _WHOLE),
    ContentFault("joints by place", joints_by_place, "joints_by_name", "state"),
    ContentFault("hands swapped in trials", hands_swapped_in_trials, "feedback", "trials_hands_cm", _WHOLE),
    ContentFault("hands swapped in cycles", hands_swapped_in_cycles, "joints_by_name", "hands_cm", _WHOLE),
)


def folder_of(fault: ContentFault) -> Path:
    """Return the case that sees a fault."""
    return data_path("golden", fault.case)
