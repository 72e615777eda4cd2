"""The rule `forward-inverse`: an inverse estimate and one Newton step on learned forward models."""

from collections.abc import Callable
from typing import Any

from pipeline.learner.rule import OnlineLearner, Rule
from pipeline.learner.rules.forward_inverse.config import ForwardInverseConfig


def _load() -> Callable[..., OnlineLearner]:
    """Return the class of the learner."""
    from pipeline.learner.rules.forward_inverse.learner import ForwardInverseLearner  # noqa: PLC0415  # numba: settings do without

    return ForwardInverseLearner


def _learner(config: ForwardInverseConfig, **centres: Any) -> OnlineLearner:
    """Make a learner of this rule."""
    return _load()(config, **centres)


RULE = Rule(ForwardInverseConfig, _learner, pairs="reached", load=_load)
