"""Whether a controller answers the targets of the page: by what it counts, whatever its commands are, and wherever."""

import json
from itertools import count

import pytest
from small_inverse import taught
from waiting import wait_until

from pipeline.browser.session.drive import TICK_NS, Drive
from pipeline.browser.session.robot_link import RobotLink
from pipeline.robot.config import load_robot
from pipeline.serving.background_writer import BackgroundWriter
from pipeline.serving.config import ServingConfig
from pipeline.serving.node import Node
from pipeline.serving.node_config import ServeConfig
from pipeline.serving.output.command_types import CommandFormat
from recorders.messages.message_types import JointState
from recorders.messages.topics import JOINT_STATES
from recorders.nodes.keys import controller_key
from recorders.wire.keys.topic_keys import NamespaceKeys
from recorders.wire.loopback import free_endpoint
from recorders.wire.publisher import TopicPublisher
from recorders.wire.session import SessionConfig, has_subscribers, open_session

COMMANDS = (CommandFormat(), CommandFormat("float64-array"), CommandFormat("trajectory", topic="/arm/commands"))


@pytest.fixture(scope="module")
def robot():
    return load_robot("asimo")


@pytest.fixture(scope="module")
def controller():
    return taught()


@pytest.mark.parametrize("commands", COMMANDS, ids=lambda commands: commands.type)
def test_errors_count_whatever_the_commands_are_and_nobody_takes_these_from_the_robot(robot, controller, commands):
    drive, endpoint, keys, stamps = Drive(robot), free_endpoint(), NamespaceKeys(), count(1)
    drive.hold()
    with (
        open_session(SessionConfig(listen=(endpoint,))) as there,
        open_session(SessionConfig(connect=(endpoint,))) as here,
        BackgroundWriter(None).running() as writer,
        RobotLink(here, drive, keys=keys) as link,
        TopicPublisher(there, keys=keys) as states,
    ):
        node = Node(controller, ServeConfig(serving=ServingConfig(commands=commands)), writer)

        def counts():
            """Report one more state, and return whether errors count."""
            stamp_ns = next(stamps) * TICK_NS
            states.publish(JOINT_STATES, JointState(stamp_ns, robot.joints, robot.comfort), log_time_ns=stamp_ns)
            link.controller_status()
            return drive.snapshot().error is not None

        with node.declared(there, where=f"at {endpoint}"):
            wait_until(counts)
            assert not has_subscribers(node._publisher)


@pytest.mark.parametrize(
    ("accepted", "answers"),
    [((0, 0), False), ((9,), False), ((9, 9), False), ((9, 0), False), ((9, 10), True), ((9, 0, 3), True)],
)
def test_a_controller_answers_once_it_has_counted_since_the_last_question_or_anew(robot, accepted, answers):
    drive, keys, replies = Drive(robot), NamespaceKeys(), iter(accepted)
    drive.hold()

    def reply(query):
        with query:
            query.reply(query.key_expr, json.dumps({"accepted": next(replies)}))

    with open_session(SessionConfig()) as session, RobotLink(session, drive, keys=keys) as link:
        link.choose("ours")
        key = controller_key(keys.namespace, "ours", "status")
        with session.declare_queryable(key, reply):
            assert [link.controller_status()["answered"] for _ in accepted] == list(accepted)
    for number in range(2):
        drive.take(number * TICK_NS, robot.comfort)
    assert drive.snapshot().is_answered is answers
