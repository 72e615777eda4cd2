"""`play --ros`: a robot of others is led by its states, and what the page starts has the same names of topics."""

from pathlib import Path

import pytest
from ros_peer import ros_peer
from waiting import wait_until

from pipeline.browser.session.controllers import Place
from pipeline.browser.session.drive import Drive
from pipeline.browser.session.robot_link import RobotLink
from pipeline.browser.teaching.lessons import _LiveCurve
from pipeline.cli.ros_domain import topic_keys
from pipeline.robot.config import load_robot
from recorders.cdr.codec import decode_as
from recorders.messages.message_types import Float64MultiArray, JointState, PoseStamped
from recorders.messages.topics import JOINT_STATES, LEARNER_ERROR, LEFT_TARGET
from recorders.wire.keys.ros_keys import RosKeys
from recorders.wire.loopback import free_endpoint
from recorders.wire.publisher import TopicPublisher
from recorders.wire.session import SessionConfig, open_session

pytest.importorskip("zenoh_ros2_sdk")

DOMAIN = 13
PERIOD_NS = 20_000_000


def test_states_of_a_robot_of_others_are_answered_with_targets() -> None:
    robot, endpoint = load_robot("asimo"), free_endpoint()
    keys = topic_keys("play", "reenact", DOMAIN, [f"{JOINT_STATES}:=/arm/state"])
    drive = Drive(robot)
    drive.hold()
    with (
        open_session(SessionConfig(listen=(endpoint,))) as session,
        keys.joined(session),
        RobotLink(session, drive, keys=keys),
        ros_peer(endpoint, domain=DOMAIN) as peer,
    ):
        peer.ask("publisher", topic="/arm/state", type_name=JointState.TYPE, name="arm")
        peer.ask("subscribe", topic=LEFT_TARGET, type_name=PoseStamped.TYPE, name="arm")
        stamps = iter(range(1, 10**6))

        def answers() -> list[PoseStamped]:
            """Publish one more state, and return the targets so far."""
            state = JointState(next(stamps) * PERIOD_NS, robot.joints, robot.comfort)
            peer.publish("/arm/state", state)
            return [decode_as(PoseStamped, bytes.fromhex(data)) for _, data in peer.ask("received")]

        wait_until(lambda: len(answers()) >= 3)
        assert {target.stamp_ns % PERIOD_NS for target in answers()} == {0}


def test_what_is_started_has_the_same_names_of_topics(tmp_path: Path) -> None:
    rules = ["__ns:=/lab", f"{JOINT_STATES}:=/arm/state", "image:=/camera"]
    keys = topic_keys("play", "reenact", DOMAIN, rules)
    with open_session(SessionConfig()) as session:
        arguments = Place(session, ("tcp/127.0.0.1:1",), keys, tmp_path, ()).arguments
    at = arguments.index("--ros")
    again = topic_keys("recorder", "reenact", int(arguments[at + 1]), arguments[at + 3 :: 2])
    assert isinstance(keys, RosKeys)
    assert isinstance(again, RosKeys)
    assert (again.domain, again.node.name.rules) == (keys.domain, keys.node.name.rules)
    assert again.node.name.full_name == "/lab/recorder"


def test_errors_of_a_learner_in_the_domain_are_points_of_the_curve(tmp_path: Path) -> None:
    robot, keys = load_robot("asimo"), topic_keys("play", "reenact", DOMAIN, [f"{LEARNER_ERROR}:=/lab/error"])
    with open_session(SessionConfig()) as session, keys.joined(session):
        curve = _LiveCurve(Drive(robot), per_round=False)
        learner = topic_keys("learner", "reenact", DOMAIN, [f"{LEARNER_ERROR}:=/lab/error"])
        with (
            curve.following(Place(session, (), keys, tmp_path, robot.hand_names)),
            TopicPublisher(session, keys=learner) as publisher,
        ):
            publisher.publish(LEARNER_ERROR, Float64MultiArray((0.01, 0.03)), log_time_ns=1)
            wait_until(lambda: curve.last_cm is not None)
    assert curve.last_cm == pytest.approx(2.0)
