"""A controller tried on a motion, beside the teacher and the linear baseline."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from pipeline.arrays import Floats
from pipeline.evaluation.errors import HandErrors, linear_joints, posture_errors, predicted_joints
from pipeline.learner.controller import Controller
from pipeline.learner.insight import KnowsDeviation
from pipeline.motions.motion import is_recorded, load_motion
from pipeline.robot.config import RobotConfig, parse_robot
from pipeline.robot.coordinates import positions_of, to_inputs
from pipeline.robot.kinematics import Kinematics
from pipeline.samples.pairing import COMMANDED, PairingRule, find_pairing, fitting_pairing
from pipeline.samples.pairs import Samples, read_samples
from recorders.containers.opening import open_log
from recorders.containers.reader import Opened, Reader
from recorders.errors import ControllerError
from recorders.messages.topics import hand_target
from recorders.reading.parts import one_session
from recorders.text.wording import names_text

REACHED = "reached"
"""Name of the pairing rule of hands as measured."""

EXPECTED_WITHIN = 0.6
"""Share of distances that should be within one deviation."""

LEAST_WITHIN = EXPECTED_WITHIN / 2.0
"""Share of them below which the deviations are not to be relied on."""

_NO_RENAMES: Mapping[str, str] = MappingProxyType({})


@dataclass(frozen=True, eq=False)
class Trial:
    """Result of a controller on a motion.

    Attributes
    ----------
    name : str
    targets : ndarray
        What is asked for, shape (T, inputs): positions [m], and turns [rad] where the pose is controlled.
    asked : ndarray
        The positions among them [m], shape (T, hands, 3).
    joints : ndarray
        Postures answered [rad or m], shape (T, n).
    reached : ndarray
        Hand positions of these postures [m], shape (T, hands, 3).
    errors : HandErrors
        Eq. (10) and its parts.
    teacher : HandErrors or None
        The same for the teacher's own postures; None where the motion was not recorded.
    linear : HandErrors or None
        The same for linear least squares, fitted to this motion as recorded, or to the recording that was named; None
        where there is neither.
    deviations : ndarray or None
        Standard deviation of each hand [m] that the controller expects, shape (T, hands); None where its rule knows
        none, or where nothing was learned yet.
    """

    name: str
    targets: Floats
    asked: Floats
    joints: Floats
    reached: Floats
    errors: HandErrors
    teacher: HandErrors | None = None
    linear: HandErrors | None = None
    deviations: Floats | None = None

    @property
    def distances(self) -> Floats:
        """Distances of the hands from their targets [m], shape (T, hands)."""
        return np.asarray(np.linalg.norm(self.reached - self.asked, axis=2))

    @property
    def doubt(self) -> str:
        """A line for where far fewer distances are within the deviations than should be; empty elsewhere."""
        if self.deviations is None or (within := float((self.distances <= self.deviations).mean())) >= LEAST_WITHIN:
            return ""
        return (
            f"not to be relied on here: {within:.0%} of the distances are within one deviation, where about "
            f"{EXPECTED_WITHIN:.0%} should be"
        )

    def summary(self) -> dict[str, Any]:
        """Return the errors as plain JSON, those of teacher and baseline under names that begin with theirs."""
        result = dict[str, Any](self.errors.to_dict())
        for name, errors in (("teacher", self.teacher), ("linear", self.linear)):
            if errors is not None:
                result[f"{name}_cm"] = errors.mean_cm
                result |= {f"{name}_{hand}_cm": error_cm for hand, error_cm in errors.hands_cm.items()}
                result |= {f"{name}_{hand}_deg": angle for hand, angle in errors.hands_deg.items()}
        if self.deviations is not None:
            result["deviation_cm"] = float(self.deviations.mean() * 100.0)
            result["within_deviation"] = float((self.distances <= self.deviations).mean())
        return result


def robot_of(controller: Controller) -> RobotConfig:
    """Return the robot of a controller, which carries it.

    Raises
    ------
    ControllerError
        If the controller is not for the hands and the joints of its own robot, in their order.
    RobotError
        If the robot cannot be used.
    """
    robot = parse_robot(controller.robot_toml, controller.robot_urdf, origin="the robot of the controller")
    if robot.joints != controller.joints or controller.config.inputs != len(robot.input_centre):
        hands = {1: "one hand", 2: "two hands"}.get(len(robot.hands), f"{len(robot.hands)} hands")
        raise ControllerError(
            f"expected a controller of {hands} and the joints of {robot.name}, "
            f"{names_text(robot.joints)}; "
            f"found {controller.config.inputs} inputs and joints {names_text(controller.joints)}"
        )
    return robot


def evaluate_motion(
    controller: Controller,
    motion: str | Path | Reader,
    *,
    linear_from: Opened | None = None,
    renames: Mapping[str, str] = _NO_RENAMES,
    linear_renames: Mapping[str, str] = _NO_RENAMES,
) -> Trial:
    """Try a controller on a recording, a CSV file or a motion known by name.

    Parameters
    ----------
    controller : Controller
        What was learned.
    motion : str, Path or Reader
        What is asked for: of a recording without targets, the hands as they were measured.
    linear_from : Path, Parts or Reader, optional
        The log that the linear baseline is fitted to; by default the motion's own, where it is one.
    renames : mapping of str to str
        Our topic names for those that a recording uses.
    linear_renames : mapping of str to str
        The same for those of `linear_from`.

    Raises
    ------
    ReenactError
        If a log or the motion cannot be read, or was recorded with a robot of other joints.
    """
    robot = robot_of(controller)
    fitted = None
    if linear_from is not None:
        linear = open_log(one_session([linear_from]) if isinstance(linear_from, Path) else linear_from)
        fitted = _samples(linear, robot, linear_renames)
        _check_joints(controller, fitted, name=str(linear.path))
    if not isinstance(motion, str | Path) or is_recorded(motion):
        reader = open_log(one_session([Path(motion)]) if isinstance(motion, str | Path) else motion)
        samples = _samples(reader, robot, renames)
        return evaluate_samples(controller, samples, name=reader.path.stem, fitted=fitted)
    loaded = load_motion(motion, robot, or_file="a CSV file, or a recording")
    return _try(controller, to_inputs(robot, loaded.targets), name=loaded.name, fitted=fitted)


def _samples(reader: Reader, robot: RobotConfig, renames: Mapping[str, str]) -> Samples:
    """Return the samples of a recording, of hands as commanded or else as reached."""
    pairing = fitting_pairing(
        trial_pairing(reader, robot.hand_names, renames),
        robot.hand_names,
        _topics(reader, renames),
        where=str(reader.path),
    )
    return read_samples(reader, robot=robot, pairs=pairing.name, renames=renames)


def trial_pairing(log: Opened, hands: Sequence[str], renames: Mapping[str, str]) -> PairingRule:
    """Return the pairs on which a controller is tried: targets as commanded if a log has them, else hands as reached.

    Parameters
    ----------
    log : Path, Parts or Reader
        The log.
    hands : sequence of str
        Names of the robot's hands.
    renames : mapping of str to str
        Our topic names for those that the log uses.
    """
    there = _topics(open_log(log), renames)
    return find_pairing(REACHED if there.isdisjoint(map(hand_target, hands)) else COMMANDED)


def _topics(reader: Reader, renames: Mapping[str, str]) -> set[str]:
    """Return the topics of a log that have messages, by our names."""
    return {renames.get(topic, topic) for topic, count in reader.counts.items() if count}


def evaluate_samples(controller: Controller, samples: Samples, *, name: str, fitted: Samples | None = None) -> Trial:
    """Try a controller on recorded samples, beside the teacher and the linear baseline, `fitted` to these or others.

    Raises
    ------
    ControllerError
        If the samples were recorded with a robot of other joints.
    """
    _check_joints(controller, samples, name=name)
    return _try(controller, samples.targets, name=name, taught=samples.joints, fitted=fitted or samples)


def _check_joints(controller: Controller, samples: Samples, *, name: str) -> None:
    if samples.robot.joints != controller.joints:
        raise ControllerError(
            f"the controller moves {names_text(controller.joints)}; {name} was recorded with {samples.robot.name}, "
            f"which has {names_text(samples.robot.joints)}"
        )


def _try(
    controller: Controller, targets: Floats, *, name: str, taught: Floats | None = None, fitted: Samples | None = None
) -> Trial:
    kinematics = Kinematics(robot_of(controller))
    learner = controller.learner()
    deviations = learner.deviations(targets) if isinstance(learner, KnowsDeviation) else None
    joints = predicted_joints(learner, targets, len(controller.joints))

    def errors(postures: Floats) -> HandErrors:
        """Return the errors of postures."""
        return posture_errors(kinematics, postures, targets)

    return Trial(
        name=name,
        targets=targets,
        asked=positions_of(kinematics.robot, targets),
        joints=joints,
        reached=kinematics.hands_along(joints),
        errors=errors(joints),
        teacher=None if taught is None else errors(taught),
        linear=None if fitted is None else errors(linear_joints(fitted.targets, fitted.joints, asked=targets)),
        deviations=None if deviations is None or not np.isfinite(deviations).all() else deviations,
    )
