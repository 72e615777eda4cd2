"""The rule `reservoir`: the paper's network, trained by Backpropagation-Decorrelation and Intrinsic Plasticity."""

from pipeline.learner.rule import Rule
from pipeline.learner.rules.reservoir.config import LearnerConfig
from pipeline.learner.rules.reservoir.learner import Learner

RULE = Rule(LearnerConfig, Learner)
