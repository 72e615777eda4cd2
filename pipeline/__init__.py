"""Robot, teacher, simulation, learner and evaluation, and the commands that wire them."""

import logging
from typing import TYPE_CHECKING

from recorders.lazy import lazy_names

if TYPE_CHECKING:
    from pipeline.deployment.deploy import deploy as deploy
    from pipeline.evaluation.errors import HandErrors as HandErrors
    from pipeline.evaluation.trials import Trial as Trial
    from pipeline.evaluation.trials import evaluate_motion as evaluate_motion
    from pipeline.exploration.explore import explore as explore
    from pipeline.exploration.source import DrawnMotion as DrawnMotion
    from pipeline.golden.runner import GoldenRunner as GoldenRunner
    from pipeline.learner.controller import Controller as Controller
    from pipeline.learner.registry import default_config as default_config
    from pipeline.learner.registry import rule_names as rule_names
    from pipeline.learner.rule import Rule as Rule
    from pipeline.learner.rule import Settings as Settings
    from pipeline.learner.rules.reservoir.config import LearnerConfig as LearnerConfig
    from pipeline.motions.motion import Motion as Motion
    from pipeline.motions.motion import NamedMotion as NamedMotion
    from pipeline.motions.motion import load_motion as load_motion
    from pipeline.robot.config import RobotConfig as RobotConfig
    from pipeline.robot.config import load_robot as load_robot
    from pipeline.robot.kinematics import Kinematics as Kinematics
    from pipeline.samples.pairing import PairingRule as PairingRule
    from pipeline.samples.pairs import Samples as Samples
    from pipeline.samples.pairs import read_samples as read_samples
    from pipeline.serving.config import ServingConfig as ServingConfig
    from pipeline.serving.served_controller import ServedController as ServedController
    from pipeline.training.checkpoints import CheckpointConfig as CheckpointConfig
    from pipeline.training.trainer import Trainer as Trainer
    from pipeline.training.trainer import train as train
    from pipeline.training.trainer import train_on as train_on

_HOMES = {
    "pipeline.exploration.source": ("DrawnMotion",),
    "pipeline.deployment.deploy": ("deploy",),
    "pipeline.evaluation.errors": ("HandErrors",),
    "pipeline.evaluation.trials": ("Trial", "evaluate_motion"),
    "pipeline.exploration.explore": ("explore",),
    "pipeline.golden.runner": ("GoldenRunner",),
    "pipeline.learner.controller": ("Controller",),
    "pipeline.learner.registry": ("default_config", "rule_names"),
    "pipeline.learner.rule": ("Rule", "Settings"),
    "pipeline.learner.rules.reservoir.config": ("LearnerConfig",),
    "pipeline.motions.motion": (
        "Motion",
        "NamedMotion",
        "load_motion",
    ),
    "pipeline.robot.config": ("RobotConfig", "load_robot"),
    "pipeline.robot.kinematics": ("Kinematics",),
    "pipeline.samples.pairing": ("PairingRule",),
    "pipeline.samples.pairs": ("Samples", "read_samples"),
    "pipeline.serving.config": ("ServingConfig",),
    "pipeline.serving.served_controller": ("ServedController",),
    "pipeline.training.checkpoints": ("CheckpointConfig",),
    "pipeline.training.trainer": ("Trainer", "train", "train_on"),
}
"""Public names by the module that each is imported from when it is asked for."""

__all__, _get, _every = lazy_names(__name__, _HOMES)

if not TYPE_CHECKING:  # where types are checked, a name that there is not stays an error
    __getattr__, __dir__ = _get, _every

logging.getLogger(__name__).addHandler(logging.NullHandler())
