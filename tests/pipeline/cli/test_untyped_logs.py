"""Logs whose writer knew no types: a message on one of our topics is of that topic's type, another type is refused."""

from pathlib import Path

import pytest
from episodes import write_episode
from sessions import write_foreign

from pipeline.samples.pairs import read_samples
from pipeline.views.view import view_log
from recorders.errors import LogError
from recorders.messages.topics import LEFT_TARGET, RIGHT_TARGET, SAMPLE_JOINTS
from recorders.reading.reader import LogReader
from recorders.rerun_scene.recording import Destination
from replay.sources.live import LiveLog
from replay.sources.scheduled import EpisodeLog

FOREIGN = {LEFT_TARGET: "/tracker/left", RIGHT_TARGET: "/tracker/right", SAMPLE_JOINTS: "/arm/joints"}
RENAMES = {foreign: ours for ours, foreign in FOREIGN.items()}


@pytest.fixture(scope="module")
def episode(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_episode(tmp_path_factory.mktemp("typed") / "log.mcap", samples=8)


@pytest.fixture(scope="module")
def untyped(episode: Path) -> Path:
    """The episode as another program writes it: names of its own, and no schemas."""
    records = [record._replace(topic=FOREIGN[record.topic], type="") for record in LogReader(episode)]
    return write_foreign(episode.with_name("untyped.mcap"), records)


def test_mapped_topics_have_the_types_of_ours(episode: Path, untyped: Path) -> None:
    assert list(EpisodeLog(untyped, renames=RENAMES)) == list(EpisodeLog(episode))
    live = list(LiveLog(untyped, renames=RENAMES).stream())
    assert live == list(LiveLog(episode).stream())


def test_topics_of_our_names_without_a_type_have_ours(episode: Path, tmp_path: Path) -> None:
    plain = write_foreign(tmp_path / "plain.mcap", [record._replace(type="") for record in LogReader(episode)])
    assert EpisodeLog(plain).digest == EpisodeLog(episode).digest
    robot = read_samples(episode).robot
    assert read_samples(plain, robot=robot).joints.tolist() == read_samples(episode).joints.tolist()


def test_they_are_shown(episode: Path, untyped: Path, tmp_path: Path) -> None:
    shown = view_log(untyped, Destination(path=tmp_path / "a.rrd"), robot="asimo", renames=RENAMES)
    assert shown == view_log(episode, Destination(path=tmp_path / "b.rrd"))


def test_a_topic_of_another_type_is_no_topic_of_ours(episode: Path, tmp_path: Path) -> None:
    wrong = [record._replace(topic=FOREIGN[record.topic], type="std_msgs/msg/String") for record in LogReader(episode)]
    log = write_foreign(tmp_path / "wrong.mcap", wrong)
    with pytest.raises(LogError, match=r"--map /arm/joints=/sample/joint_states: expected a topic of sensor_msgs/msg"):
        EpisodeLog(log, renames=RENAMES)
    with pytest.raises(LogError, match=r": expected geometry_msgs/msg/PoseStamped, found 'std_msgs/msg/String'"):
        view_log(log, Destination(path=tmp_path / "a.rrd"), robot="asimo", renames=RENAMES)
