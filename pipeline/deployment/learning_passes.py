"""A controller that goes on learning while it leads the simulated robot through a motion, pass after pass."""

from typing import NamedTuple

import numpy as np

from pipeline.arrays import Floats
from pipeline.evaluation.errors import hand_errors
from pipeline.evaluation.trials import robot_of
from pipeline.learner.controller import Controller
from pipeline.motions.motion import Motion
from pipeline.robot.backend import RobotBackend
from pipeline.robot.coordinates import POSITION_SIZE, to_inputs
from pipeline.robot.kinematics import Kinematics
from pipeline.robot.telemetry import hand_message, hand_messages, joints_message
from pipeline.serving.config import ServingConfig
from pipeline.serving.served_controller import ServedController
from pipeline.simulation.joint_offset import OffsetRobot
from pipeline.simulation.simulation import Simulation
from recorders.cdr.codec import decode_as, encode
from recorders.errors import ControllerError
from recorders.messages.message_types import JointState, Message
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import SAMPLE_JOINTS, hand_target

_CM_PER_M = 100.0


class PassErrors(NamedTuple):
    """Mean distances of the hands from their targets over a pass [cm].

    Attributes
    ----------
    settled_cm : float
        Of where each command leads once the servos have settled.
    held_cm : float
        Of where the hands are at the end of the hold of each target.
    """

    settled_cm: float
    held_cm: float


def serve_passes(
    controller: Controller,
    motion: Motion,
    *,
    passes: int,
    learn: bool = True,
    offsets: Floats | None = None,
    period_ns: int = 100_000_000,
) -> list[PassErrors]:
    """Let a served controller lead the simulated robot through a motion again and again, in process.

    At the end of each hold, hands and joints are measured at one instant, and learned before the next target comes.

    Parameters
    ----------
    controller : Controller
        What was taught; it stays as it is.
    motion : Motion
        What is asked for, one target each period.
    passes : int
        How many.
    learn : bool
        Whether it goes on learning.
    offsets : ndarray, shape (n,), optional
        How far sensors and motors of the joints are off [rad or m].
    period_ns : int
        How long each target is held [ns].

    Raises
    ------
    ControllerError
        If a target is refused.
    """
    robot, offsets = robot_of(controller), np.zeros(len(controller.joints)) if offsets is None else offsets
    backend, kinematics = OffsetRobot(Simulation(robot), offsets), Kinematics(robot)
    served = ServedController(controller, config=ServingConfig(learn=learn))
    targets, errors = to_inputs(robot, motion.targets), []
    for _ in range(passes):
        postures, reached = np.empty((len(motion), len(robot.joints))), np.empty(motion.targets.shape)
        for k, target in enumerate(motion.targets):
            postures[k] = command = _answer(served, backend, target)
            backend.advance(command, period_ns)
            reached[k] = backend.hands()
            _measure(served, backend)
        held = np.linalg.norm((reached - motion.targets)[..., :POSITION_SIZE], axis=2)
        settled = hand_errors(kinematics, postures - offsets, targets)
        errors.append(PassErrors(float(settled.mean()) * _CM_PER_M, float(held.mean()) * _CM_PER_M))
    return errors


def _answer(served: ServedController, backend: RobotBackend, targets: Floats) -> Floats:
    """Return the posture (n,) that a served controller commands for targets by row."""
    command = None
    for name, target in zip(backend.robot.hand_names, targets, strict=True):
        command = served.take(_record(hand_target(name), hand_message(backend.time_ns, target)))
    if command is None:
        raise ControllerError(f"the targets at {backend.time_ns} ns were refused: {served.status()['last_refusal']}")
    served.settle()
    return decode_as(JointState, command.data).position


def _measure(served: ServedController, backend: RobotBackend) -> None:
    """Let a served controller have hands and joints of this instant."""
    for topic, message in (*hand_messages(backend), (SAMPLE_JOINTS, joints_message(backend))):
        served.take(_record(topic, message))


def _record(topic: str, message: Message) -> RecordedMessage:
    return RecordedMessage(topic, message.TYPE, encode(message), 0, 0)
