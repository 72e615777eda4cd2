"""A learner in a ROS domain learns from what is well formed alone: whatever keys and attachments others make up."""

import threading
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
import zenoh
from episodes import write_episode

from pipeline.learner.rules.reservoir.config import LearnerConfig
from pipeline.learner_node.live_learner import LiveConfig, LiveLearner
from pipeline.learner_node.publisher import LearnerPublisher
from pipeline.robot.config import load_robot
from pipeline.training.trainer import Trainer
from recorders.cdr.codec import encode
from recorders.messages.message_types import JointState, PoseStamped
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import LEFT_TARGET, RIGHT_TARGET, SAMPLE_JOINTS
from recorders.protocol.frames import MAX_PAYLOAD
from recorders.reading.reader import LogReader
from recorders.rmw_zenoh.attachment import Attachment
from recorders.rmw_zenoh.names import NodeName
from recorders.rmw_zenoh.type_hashes import type_hash
from recorders.wire.keys.ros_keys import RosKeys
from recorders.wire.loopback import free_endpoint
from recorders.wire.receiver import Receiver, ReceiverConfig
from recorders.wire.session import SessionConfig, open_session

TICKS, DOMAIN = 20, 4
KEYS = RosKeys(DOMAIN, NodeName("learner"))
TYPES = {LEFT_TARGET: PoseStamped.TYPE, RIGHT_TARGET: PoseStamped.TYPE, SAMPLE_JOINTS: JointState.TYPE}
GID, OTHER_GID = b"tracker" + bytes(9), b"stranger" * 2
LEFT = KEYS.key(LEFT_TARGET)
POSE = encode(PoseStamped(2_100_000_000, [0.3, 0.2, 0.7]))
NUMBERED = Attachment(1, 1, OTHER_GID).pack()
HOSTILE: list[tuple[str, bytes, bytes | None]] = [
    # attachments: of other lengths, another name's length, negative numbers, and ours made up behind rmw_zenoh's
    *((LEFT, POSE, bad) for bad in (b"", b"\0" * 32, b"\xff" * 33, NUMBERED[:16] + b"\x07" + NUMBERED[17:])),
    (LEFT, POSE, bytes(70_000)),
    # payloads: too short, too long, of another type, no number, too large
    (LEFT, POSE[:-1], NUMBERED),
    (LEFT, b"", NUMBERED + bytes(56)),
    (LEFT, encode(JointState(0, ("antenna",), [0.0])), NUMBERED),
    (LEFT, encode(PoseStamped(2_100_000_000, [np.nan, 0.2, 0.7])), NUMBERED),
    (KEYS.key(SAMPLE_JOINTS), bytes(MAX_PAYLOAD + 1), NUMBERED),
    # keys: another type or hash than the topic's, a domain of somebody else, parts that are none
    (KEYS.key(LEFT_TARGET, JointState.TYPE), encode(JointState(0, ("antenna",), [0.0])), NUMBERED),
    (LEFT.replace(type_hash(PoseStamped.TYPE), "RIHS01_" + 64 * "a"), POSE[:-8], NUMBERED),
    (LEFT.replace(type_hash(PoseStamped.TYPE), "RIHS01_no"), POSE, NUMBERED),
    (LEFT.replace(f"{DOMAIN}/", f"{DOMAIN + 1}/", 1), POSE, NUMBERED),
    (f"{DOMAIN}/\x1b[2J/a/b", POSE, NUMBERED),
    (f"{DOMAIN}/a", POSE, NUMBERED),
]
"""Key, payload and attachment of each message that means ill."""


@pytest.fixture(scope="module")
def sent(tmp_path_factory: pytest.TempPathFactory) -> list[RecordedMessage]:
    path = write_episode(tmp_path_factory.mktemp("company") / "log.mcap", samples=TICKS - 1)
    return list(LogReader(path))


def put(session: zenoh.Session, key: str, data: bytes, attachment: bytes | None) -> None:
    session.put(key, data, attachment=attachment, congestion_control=zenoh.CongestionControl.BLOCK)


def learned(sent: Sequence[RecordedMessage], *, hostile: bool, topics: dict[str, str] | None) -> dict[str, Any]:
    """Learn from messages as rmw_zenoh sends them, with those that mean ill in the midst of them if wanted."""
    endpoint, arrived, robot = free_endpoint(), threading.Event(), load_robot("asimo")
    with (
        open_session(SessionConfig(listen=(endpoint,))) as session,
        LearnerPublisher(session, keys=KEYS) as publisher,
        Receiver(session, config=ReceiverConfig(live=True, keys=KEYS, topics=topics)) as receiver,
        open_session(SessionConfig(connect=(endpoint,))) as other,
    ):
        session.declare_subscriber("after", lambda sample: arrived.set())
        for index, record in enumerate(sent):
            if hostile and index == len(sent) // 2:
                for key, data, attachment in HOSTILE:
                    put(other, key, data, attachment)
            put(other, KEYS.key(record.topic), record.data, Attachment(index + 1, index, GID).pack())
        put(other, "after", b"", None)
        assert arrived.wait(120)
        learner = LiveLearner(Trainer(LearnerConfig(seed=3), robot=robot), robot, LiveConfig(), receiver, publisher)
        return learner.run(lambda: True, keep=lambda record: None)


@pytest.mark.parametrize(
    ("topics", "unreadable", "elsewhere"), [(None, 6, {"elsewhere: unread": 3}), (TYPES, 4, {})], ids=["all", "wanted"]
)
def test_what_means_ill_changes_nothing_and_is_counted(
    sent: list[RecordedMessage], topics: dict[str, str] | None, unreadable: int, elsewhere: dict[str, int]
) -> None:
    """A learner that subscribes to what it wants alone gets nothing of other types and hashes."""
    alone, beside = (learned(sent, hostile=hostile, topics=topics) for hostile in (False, True))
    for key in ("digest", "stream_digest", "steps", "ticks", "train_cm"):
        assert alone[key] == beside[key]
    assert (alone["ticks"], alone["refused"]) == (TICKS, {})
    assert beside["refused"] == elsewhere | {
        f"{LEFT_TARGET}: unread": 5,
        f"{LEFT_TARGET}: unreadable": unreadable,
        f"{SAMPLE_JOINTS}: unread": 1,
    }
