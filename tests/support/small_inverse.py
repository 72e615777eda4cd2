"""A small controller of the rule that learns from what is reached, and the ticks that it sees while it serves."""

import numpy as np

from pipeline.learner.body import body_of
from pipeline.learner.controller import Controller
from pipeline.learner.rules.forward_inverse.config import ForwardInverseConfig
from pipeline.learner.rules.forward_inverse.learner import ForwardInverseLearner
from pipeline.robot.config import load_robot
from pipeline.robot.kinematics import Kinematics
from recorders.cdr.codec import encode
from recorders.messages.message_types import JointState, PoseStamped
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import SAMPLE_JOINTS, hand_measured, hand_target

ROBOT = load_robot("asimo")


def postures(count: int, *, seed: int, spread: float = 0.1) -> np.ndarray:
    """Joints about the comfort posture, as far as a part of their ranges."""
    span = ROBOT.upper - ROBOT.lower
    drawn = ROBOT.comfort + spread * span * np.random.default_rng(seed).uniform(-1.0, 1.0, (count, len(span)))
    return np.clip(drawn, ROBOT.lower, ROBOT.upper)


def hands_at(joints: np.ndarray) -> np.ndarray:
    """Hands where the joints bring them, shape (n, 2, 3)."""
    return Kinematics(ROBOT).hands_along(joints)


def taught(*, samples: int = 400, **settings: float) -> Controller:
    """Return a controller that has learned some postures, from pairs as reached."""
    config = ForwardInverseConfig(degree=2, **settings).with_body(body_of(ROBOT))  # type: ignore[arg-type]
    centre = np.concatenate([ROBOT.input_centre, ROBOT.comfort])
    learner = ForwardInverseLearner(config, input_centre=ROBOT.input_centre, output_centre=centre)
    joints = postures(samples, seed=0)
    hands = hands_at(joints).reshape(samples, 6)
    learner.step(hands, np.concatenate([hands, joints], axis=1), learning=True)
    return Controller.from_learner(
        learner, joints=ROBOT.joints, robot_toml=ROBOT.toml_text, robot_urdf=ROBOT.urdf_text, pairs="reached"
    )


def asked(stamp_ns: int, hands: np.ndarray) -> list[RecordedMessage]:
    """Return the targets of both hands, shape (2, 3) [m]."""
    names = zip(ROBOT.hand_names, hands, strict=True)
    return [_record(hand_target(name), PoseStamped(stamp_ns, hand)) for name, hand in names]


def measured(stamp_ns: int, joints: np.ndarray, hands: np.ndarray) -> list[RecordedMessage]:
    """Return hands, shape (2, 3) [m], and joints of one instant."""
    names = zip(ROBOT.hand_names, hands, strict=True)
    poses = [_record(hand_measured(name), PoseStamped(stamp_ns, hand)) for name, hand in names]
    return [*poses, _record(SAMPLE_JOINTS, JointState(stamp_ns, ROBOT.joints, joints))]


def _record(topic: str, message: PoseStamped | JointState) -> RecordedMessage:
    return RecordedMessage(topic, message.TYPE, encode(message), 0, message.stamp_ns)
