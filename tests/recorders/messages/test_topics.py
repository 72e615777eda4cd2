import pytest

from recorders.cdr.rosbags_types import schema_text
from recorders.messages.message_types import MESSAGE_TYPES, JointState, PoseStamped
from recorders.messages.topics import LEARNER_TOPICS, TOPICS, type_of


def test_the_learner_reads_targets_left_then_right_then_joints():
    assert [(topic.name, topic.type) for topic in LEARNER_TOPICS] == [
        ("/hand/left/target", PoseStamped.TYPE),
        ("/hand/right/target", PoseStamped.TYPE),
        ("/sample/joint_states", JointState.TYPE),
    ]
    assert [topic.rank for topic in LEARNER_TOPICS] == [0, 1, 2]


def test_ranks_are_the_places_in_the_table():
    assert [topic.rank for topic in TOPICS.values()] == list(range(len(TOPICS)))
    assert all(name == topic.name for name, topic in TOPICS.items())


@pytest.mark.parametrize("topic", TOPICS.values(), ids=lambda topic: topic.name)
def test_every_topic_has_a_message_class_and_a_schema(topic):
    assert topic.type in MESSAGE_TYPES
    assert schema_text(topic.type)
    assert type_of(topic.name) == topic.type


def test_foreign_topics_have_no_type():
    assert type_of("/camera/image") == ""
