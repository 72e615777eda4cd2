"""The rule `forward-inverse`: an inverse estimate and one Newton step on learned forward models."""

from pipeline.learner.rule import Rule
from pipeline.learner.rules.forward_inverse.config import ForwardInverseConfig
from pipeline.learner.rules.forward_inverse.learner import ForwardInverseLearner

RULE = Rule(ForwardInverseConfig, ForwardInverseLearner, pairs="reached")
