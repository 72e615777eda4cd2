"""A controller tried on a motion, beside the teacher and the linear baseline."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.controller import Controller
from pipeline.evaluation import HandErrors, hand_errors, linear_joints, predicted_joints
from pipeline.kinematics import Kinematics
from pipeline.motions import load_motion
from pipeline.robot import RobotConfig, parse_robot
from pipeline.samples import Samples, read_samples
from recorders.errors import ControllerError

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Trial:
    """What a controller made of a motion.

    Attributes
    ----------
    name : str
    targets : hand positions asked for [m], left then right, shape (T, 6)
    joints : postures answered [rad or m], shape (T, n)
    reached : hand positions of these postures [m], shape (T, 2, 3)
    errors : eq. (10) and its parts
    teacher, linear : the same for the teacher's own postures and for linear least squares on the same data; None where
        the motion was not recorded
    """

    name: str
    targets: Floats
    joints: Floats
    reached: Floats
    errors: HandErrors
    teacher: HandErrors | None = None
    linear: HandErrors | None = None


def robot_of(controller: Controller) -> RobotConfig:
    """Return the robot that a controller was made for; the controller carries it."""
    return parse_robot(controller.robot_toml, controller.robot_urdf)


def try_motion(controller: Controller, motion: str | Path) -> Trial:
    """Try a controller on a log (`.mcap`), a CSV file or a motion known by name.

    Raises
    ------
    ReenactError
        If the log or motion cannot be read, or was recorded with a robot of other joints.
    """
    if Path(motion).suffix == ".mcap":
        return try_samples(controller, read_samples(Path(motion)), name=Path(motion).stem)
    loaded = load_motion(motion, robot_of(controller))
    return _try(controller, loaded.targets.reshape(-1, 6), name=loaded.name)


def try_samples(controller: Controller, samples: Samples, *, name: str) -> Trial:
    """Try a controller on recorded samples, beside the teacher and the linear baseline."""
    if samples.robot.joints != controller.joints:
        raise ControllerError(
            f"the controller moves {', '.join(controller.joints)}; {name} was recorded with {samples.robot.name}, "
            f"which has {', '.join(samples.robot.joints)}"
        )
    return _try(controller, samples.targets, name=name, taught=samples.joints)


def _try(controller: Controller, targets: Floats, *, name: str, taught: Floats | None = None) -> Trial:
    kinematics = Kinematics(robot_of(controller))
    joints = predicted_joints(controller.learner(), targets, len(controller.joints))

    def errors(postures: Floats) -> HandErrors:
        return HandErrors.of(hand_errors(kinematics, postures, targets))

    return Trial(
        name=name,
        targets=targets,
        joints=joints,
        reached=kinematics.hands_along(joints),
        errors=errors(joints),
        teacher=None if taught is None else errors(taught),
        linear=None if taught is None else errors(linear_joints(targets, taught)),
    )
