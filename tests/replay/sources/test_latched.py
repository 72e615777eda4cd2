"""Latched messages from before what is played come first, each as often as a late joiner would have had it."""

from collections import Counter
from dataclasses import replace
from pathlib import Path

import pytest
from bags import ros1_bag
from rosbags.interfaces import Qos as TheirQos
from rosbags.interfaces import QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from recorders.cdr.codec import decode_as, encode
from recorders.errors import LogError
from recorders.messages.message_types import String
from recorders.messages.record import RecordedMessage
from recorders.rmw_zenoh.bag_channels import QOS_METADATA, bag_channel
from recorders.rmw_zenoh.qos import LATCHED, Durability, Qos, Reliability
from recorders.rmw_zenoh.type_hashes import UNKNOWN_HASH
from recorders.writing.writer import LogWriter
from replay.sources.playback import Playback, PlaybackConfig

START_NS = 1_700_000_000_000_000_000
SECOND_NS = 10**9
TWO = Qos(Reliability.BEST_EFFORT, Durability.TRANSIENT_LOCAL, depth=2)
OFFERED = {"/map": TWO, "/chatter": Qos(), "/robot_description": LATCHED}


def write(path: Path, rows: list[tuple[str, str, int, int]]) -> Path:
    """Write texts by topic, log time and publish time [s] since the start."""
    with LogWriter(path, manifest={"kind": "recording"}) as log:
        for topic, text, time_s, published_s in rows:
            log.write(
                topic,
                encode(String(text)),
                log_time_ns=START_NS + time_s * SECOND_NS,
                publish_time_ns=START_NS + published_s * SECOND_NS,
                declared=bag_channel(topic, String.TYPE, UNKNOWN_HASH, [OFFERED[topic]]),
            )
    return path


def played(path: Path, **options: int) -> list[tuple[str, int]]:
    """Return text and log time [s] of what is played."""
    stream = Playback([path], PlaybackConfig(latched_first=True, **options)).stream()
    return [(text_of(record), (record.log_time_ns - START_NS) // SECOND_NS) for record in stream]


def text_of(record: RecordedMessage) -> str:
    return decode_as(String, record.data).data


ROWS = [
    ("/chatter", "a", 0, 0),
    ("/map", "m0", 1, -9),
    ("/map", "m1", 2, 2),
    ("/robot_description", "urdf", 3, -5),
    ("/chatter", "b", 4, 4),
    ("/map", "m2", 5, 5),
    ("/chatter", "c", 6, 6),
]


def test_what_was_published_before_the_recording_comes_first(tmp_path: Path) -> None:
    """And nothing else is moved: what is latched later has its time."""
    found = played(write(tmp_path / "log.mcap", ROWS))
    assert found == [("m0", 0), ("urdf", 0), ("a", 0), ("m1", 2), ("b", 4), ("m2", 5), ("c", 6)]


def test_after_a_start_a_late_joiner_has_what_was_latched_by_then(tmp_path: Path) -> None:
    path = write(tmp_path / "log.mcap", ROWS)
    assert played(path, start_ns=6 * SECOND_NS) == [("m1", 6), ("urdf", 6), ("m2", 6), ("c", 6)]
    assert played(path, start_ns=2 * SECOND_NS) == [("m0", 2), ("m1", 2), ("urdf", 2), ("b", 4), ("m2", 5), ("c", 6)]


def test_no_more_of_a_topic_is_moved_than_it_keeps(tmp_path: Path) -> None:
    rows = [("/chatter", "a", 0, 0), *(("/map", f"m{number}", 1 + number, -1) for number in range(4))]
    assert played(write(tmp_path / "log.mcap", rows)) == [("m0", 0), ("m1", 0), ("a", 0), ("m2", 3), ("m3", 4)]


def test_each_round_begins_alike(tmp_path: Path) -> None:
    path = write(tmp_path / "log.mcap", ROWS)
    assert played(path, start_ns=5 * SECOND_NS, loops=2) == 2 * played(path, start_ns=5 * SECOND_NS)
    config = PlaybackConfig(latched_first=True, start_ns=5 * SECOND_NS)
    assert list(Playback([path], config).stream(2)) == list(Playback([path], config).stream())[2:]
    assert Playback([path], config).offer().run != Playback([path], PlaybackConfig(start_ns=5 * SECOND_NS)).offer().run


@pytest.mark.parametrize("version", [8, 9])
@pytest.mark.parametrize("storage", [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
def test_bags_of_others_are_offered_as_they_were_recorded(tmp_path: Path, version: int, storage: StoragePlugin) -> None:
    endless = QosTime(9223372036, 854775807)
    profile = TheirQos(
        QosHistory.KEEP_LAST,
        2,
        QosReliability.BEST_EFFORT,
        QosDurability.TRANSIENT_LOCAL,
        endless,
        endless,
        QosLiveliness.AUTOMATIC,
        endless,
        False,
    )
    store = get_typestore(Stores.ROS2_JAZZY)
    with Writer(tmp_path / "bag", version=version, storage_plugin=storage) as bag:
        topics = {
            topic: bag.add_connection(topic, String.TYPE, typestore=store, offered_qos_profiles=profiles)
            for topic, profiles in {"/map": [profile], "/tf_static": [], "/chatter": []}.items()
        }
        for time_s, (topic, connection) in enumerate(topics.items()):
            bag.write(connection, START_NS + time_s * SECOND_NS, encode(String(topic)))
    config = PlaybackConfig(latched_first=True, start_ns=2 * SECOND_NS, renames={"/map": "/site"})
    playback = Playback([tmp_path / "bag"], config)
    assert playback.qos == {"/site": TWO, "/tf_static": LATCHED, "/chatter": Qos()}
    assert [text_of(record) for record in playback.stream()] == ["/map", "/tf_static", "/chatter"]


def test_what_is_no_quality_of_service_is_one_clear_line(tmp_path: Path) -> None:
    channel = replace(bag_channel("/map", String.TYPE, UNKNOWN_HASH, []), metadata=((QOS_METADATA, "- depth: deep"),))
    with LogWriter(tmp_path / "log.mcap", manifest={}) as log:
        log.write("/map", encode(String("a")), log_time_ns=START_NS, declared=channel)
    assert list(Playback([tmp_path / "log.mcap"]).stream())
    with pytest.raises(LogError, match=r"log\.mcap: /map: quality of service: expected a profile of rosbag2, found"):
        Playback([tmp_path / "log.mcap"], PlaybackConfig(latched_first=True))


def test_a_message_of_time_0_is_before_a_start(
    tmp_path: Path,
) -> None:
    with LogWriter(tmp_path / "log.mcap", manifest={}) as log:
        for topic, text, time_ns in (("/map", "m", 0), ("/chatter", "a", 1), ("/chatter", "b", 2 * SECOND_NS)):
            declared = bag_channel(topic, String.TYPE, UNKNOWN_HASH, [OFFERED[topic]])
            log.write(topic, encode(String(text)), log_time_ns=time_ns, declared=declared)
    config = PlaybackConfig(latched_first=True, start_ns=SECOND_NS)
    found = [(text_of(record), record.log_time_ns) for record in Playback([tmp_path / "log.mcap"], config).stream()]
    assert found == [("m", SECOND_NS), ("b", 2 * SECOND_NS)]


def test_a_container_that_keeps_no_publish_times_is_played_whole(tmp_path: Path) -> None:
    bag = ros1_bag(tmp_path / "session.bag")
    early, plain = (Playback([bag], PlaybackConfig(latched_first=first)).stream() for first in (True, False))
    assert Counter((record.topic, bytes(record.data)) for record in early) == Counter(
        (record.topic, bytes(record.data)) for record in plain
    )
