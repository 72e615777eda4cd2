"""A controller of a hand whose pose is controlled answers poses, learns from them, and refuses those that cannot be."""

from pathlib import Path

import numpy as np
import pytest
from more_hands import ONE, write_robot

from pipeline.arrays import Floats
from pipeline.evaluation.errors import posture_errors
from pipeline.learner.body import body_of
from pipeline.learner.controller import Controller
from pipeline.learner.rules.forward_inverse.config import ForwardInverseConfig
from pipeline.learner.rules.forward_inverse.learner import ForwardInverseLearner
from pipeline.robot.config import RobotConfig, load_robot
from pipeline.robot.coordinates import to_inputs, to_rows
from pipeline.robot.kinematics import Kinematics
from pipeline.robot.range_check import range_check
from pipeline.robot.telemetry import hand_message
from pipeline.rotations import product, quaternions_of
from pipeline.serving.config import ServingConfig
from pipeline.serving.served_controller import ServedController
from recorders.cdr.codec import decode_as, encode
from recorders.messages.message_types import JointState, PoseStamped
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import SAMPLE_JOINTS, commanded_tick, hand_measured, hand_target
from recorders.ticks.live import LiveTicks
from recorders.ticks.stamp_joiner import RejectionError

(TIP,) = ONE
PERIOD_NS = 20_000_000


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> RobotConfig:
    return load_robot(write_robot(tmp_path_factory.mktemp("posed") / "robot", ONE, poses=ONE))


def samples(robot: RobotConfig, count: int, seed: int) -> tuple[Floats, Floats]:
    """Return inputs and joints that belong together, about the comfort posture."""
    spread = 0.15 * np.random.default_rng(seed).uniform(-1.0, 1.0, (count, len(robot.joints)))
    joints: Floats = robot.comfort + spread
    return Kinematics(robot).inputs_along(joints), joints


@pytest.fixture(scope="module")
def controller(robot: RobotConfig) -> Controller:
    u, joints = samples(robot, 600, seed=1)
    learner = ForwardInverseLearner(
        ForwardInverseConfig().with_body(body_of(robot)),
        input_centre=robot.input_centre,
        output_centre=np.concatenate([robot.input_centre, robot.comfort]),
    )
    learner.step(u, np.concatenate([u, joints], axis=1), learning=True)
    texts = {"robot_toml": robot.toml_text, "robot_urdf": robot.urdf_text}
    return Controller.from_learner(learner, joints=robot.joints, pairs="reached", provenance={}, **texts)


def pose_record(topic: str, pose: PoseStamped) -> RecordedMessage:
    return RecordedMessage(topic, PoseStamped.TYPE, encode(pose), 0, 0)


def test_it_is_saved_and_answers_as_it_predicts(robot: RobotConfig, controller: Controller, tmp_path: Path) -> None:
    controller.save(tmp_path / "posed.npz")
    loaded = Controller.load(tmp_path / "posed.npz")
    assert loaded.digest == controller.digest
    assert loaded.config.inputs == 6
    u, _ = samples(robot, 40, seed=2)
    served, answers = ServedController(loaded), list[Floats]()
    rows = to_rows(robot, u)
    for stamp, row in enumerate(rows, 1):
        record = pose_record(hand_target(TIP), hand_message(stamp * PERIOD_NS, row[0]))
        command = served.take(record)
        assert command is not None
        answers.append(decode_as(JointState, command.data).position)
    predicted = loaded.learner().predict(to_inputs(robot, rows))[:, 6:]
    np.testing.assert_array_equal(answers, np.clip(predicted, robot.lower, robot.upper))
    errors = posture_errors(Kinematics(robot), np.array(answers), u)
    assert errors.mean_cm < 0.2
    assert errors.hands_deg[TIP] < 0.3


def test_it_learns_on_from_poses_as_measured(robot: RobotConfig, controller: Controller) -> None:
    served = ServedController(controller, config=ServingConfig(learn=True))
    alone = controller.adaptive().learner()
    u, joints = samples(robot, 10, seed=3)
    rows = to_rows(robot, u)
    for index, (row, posture) in enumerate(zip(rows, joints, strict=True), 1):
        stamp = index * PERIOD_NS
        served.take(pose_record(hand_measured(TIP), hand_message(stamp, row[0])))
        measured = JointState(stamp, robot.joints, posture)
        served.take(RecordedMessage(SAMPLE_JOINTS, JointState.TYPE, encode(measured), 0, 0))
        read = to_inputs(robot, row)[np.newaxis]
        alone.step(read, np.concatenate([read, posture[np.newaxis]], axis=1), learning=True)
    assert served.status()["learned_steps"] == 10
    for name, values in served.controller().state.items():
        assert values.tobytes() == alone.state()[name].tobytes()


def wrong_poses(robot: RobotConfig) -> dict[str, PoseStamped]:
    centre, middle = np.array(robot.hands[0].centre), robot.hands[0].orientation
    return {
        "within 149 degrees": PoseStamped(1, centre, orientation=product(quaternions_of([0.0, 3.0, 0.0]), middle)),
        "unit quaternion": PoseStamped(1, centre, orientation=np.zeros(4)),
        "found length nan": PoseStamped(1, centre, orientation=np.full(4, np.nan)),
    }


@pytest.mark.parametrize("reason", ["within 149 degrees", "unit quaternion", "found length nan"])
def test_a_pose_that_cannot_be_is_refused_and_changes_nothing(
    robot: RobotConfig, controller: Controller, reason: str
) -> None:
    lines = list[str]()
    served = ServedController(controller, report=lines.append)
    before = served.status()["digest"]
    assert served.take(pose_record(hand_target(TIP), wrong_poses(robot)[reason])) is None
    status = served.status()
    assert (status["accepted"], sum(status["refused"].values()), status["digest"]) == (0, 1, before)
    assert reason in status["last_refusal"]
    check = range_check(robot)
    ticks = LiveTicks(check, commanded_tick(ONE), check.poses)
    with pytest.raises(RejectionError, match=reason) as refused:
        ticks.feed(pose_record(hand_target(TIP), wrong_poses(robot)[reason]), numbered=False)
    assert refused.value.kind == ("implausible" if reason == "within 149 degrees" else "unreadable")
