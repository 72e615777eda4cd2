"""The rule `reservoir`: the paper's network, trained by Backpropagation-Decorrelation and Intrinsic Plasticity."""

from collections.abc import Callable
from typing import Any

from pipeline.learner.rule import OnlineLearner, Rule
from pipeline.learner.rules.reservoir.config import LearnerConfig


def _load() -> Callable[..., OnlineLearner]:
    """Return the class of the learner."""
    from pipeline.learner.rules.reservoir.learner import Learner  # noqa: PLC0415  # numba: settings do without

    return Learner


def _learner(config: LearnerConfig, **centres: Any) -> OnlineLearner:
    """Make a learner of this rule."""
    return _load()(config, **centres)


RULE = Rule(LearnerConfig, _learner, load=_load)
