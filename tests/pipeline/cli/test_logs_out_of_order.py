"""A log whose chunks stand in another order than they were recorded in teaches and is tested like any other."""

from pathlib import Path

import pytest
from episodes import PERIOD_NS, write_episode
from mcap.writer import Writer
from sessions import write_foreign

from pipeline.cli import app
from pipeline.exploration.hand_paths import pose_topics, read_log_paths
from pipeline.samples.pairs import read_samples
from recorders.cdr.codec import encode
from recorders.errors import LogError
from recorders.messages.message_types import String
from recorders.messages.phase import LEARN, Phase
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import SESSION_PHASE
from recorders.reading.reader import LogReader
from replay.sources.live import LiveLog
from replay.sources.scheduled import EpisodeLog
from replay.sources.session import RecordedSession

SAMPLES = 11


@pytest.fixture(scope="module")
def episode(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_episode(tmp_path_factory.mktemp("order") / "episode.mcap", samples=SAMPLES)


def write(path: Path, source: Path, records: list[RecordedMessage]) -> Path:
    """Write messages as another program does, two ticks a chunk, in the order given, with the robot of a log."""
    reader = LogReader(source)
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="ros2", library="other")
        for name in reader.attachments:
            writer.add_attachment(0, 0, name, "", reader.attachment(name))
        channels = {
            topic: writer.register_channel(topic, "cdr", writer.register_schema(kind, "ros2msg", b""))
            for topic, kind in reader.topics.items()
        }
        for place, record in enumerate(records):
            time_ns = record.log_time_ns
            writer.add_message(channels[record.topic], time_ns, record.data, time_ns, record.sequence)
            if place % 6 == 5:
                writer.flush()
        writer.finish()
    return path


@pytest.fixture(scope="module")
def shuffled(episode: Path) -> Path:
    """The episode in chunks of which the latest stands first; the messages inside run backwards."""
    return write(episode.with_name("shuffled.mcap"), episode, list(LogReader(episode))[::-1])


def test_it_is_the_same_episode(episode: Path, shuffled: Path) -> None:
    assert EpisodeLog(shuffled).digest == EpisodeLog(episode).digest
    assert (read_samples(shuffled).targets == read_samples(episode).targets).all()
    assert (read_samples(shuffled).joints == read_samples(episode).joints).all()


def test_every_pose_is_shown(episode: Path, shuffled: Path) -> None:
    found, expected = (
        read_log_paths(log, pose_topics(None, ("left", "right"), hand=None)) for log in (shuffled, episode)
    )
    assert found.source["left_out"] == {}
    for hand, path in expected.paths.items():
        assert (found.paths[hand].points == path.points).all()


def test_as_live_says_what_to_run(shuffled: Path, caplog: pytest.LogCaptureFixture) -> None:
    with pytest.raises(LogError, match=rf"the {SAMPLES} steps that there are by log time, found \d; train without"):
        LiveLog(shuffled)
    assert caplog.messages == []


def test_as_live_goes_by_the_file_where_a_clock_was_set_back(episode: Path, tmp_path: Path) -> None:
    """Stamps go on; the recorder's clock began anew in the middle."""
    records = list(LogReader(episode))
    half = len(records) // 6 * 3
    back = [record._replace(log_time_ns=record.log_time_ns - 6 * PERIOD_NS) for record in records[half:]]
    log = LiveLog(write(tmp_path / "back.mcap", episode, records[:half] + back))
    heard = [record for record in log.stream() if record.topic == records[0].topic]
    assert [record.data for record in heard] == [each.data for each in records if each.topic == records[0].topic]


def test_as_recorded_goes_by_the_file(episode: Path, tmp_path: Path) -> None:
    marker = Phase("ab" * 16, 0, 0, LEARN, log="").to_message()
    begin = RecordedMessage(SESSION_PHASE, String.TYPE, encode(marker), 0, 2**40)
    records = [begin, *LogReader(episode)]
    path = write_foreign(tmp_path / "session.mcap", records)
    assert next(iter(LogReader(path))) == records[1]
    assert list(RecordedSession(path, epochs=1).stream()) == records


def test_a_golden_case_of_it_holds(shuffled: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "learner.toml").write_text("reservoir = 30\nseed = 4\n")
    for arguments in (["add", str(shuffled), "--config", "learner.toml", "--name", "a"], ["check", "golden"]):
        with pytest.raises(SystemExit) as ended:
            app.main(["golden", *arguments])
        assert ended.value.code == 0


def test_a_clock_that_stepped_back_is_named_with_what_takes_the_log(
    episode: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    records = list(LogReader(episode))
    stepped = [
        record._replace(log_time_ns=record.log_time_ns + (3_600_000_000_000 if place <= len(records) // 2 else 0))
        for place, record in enumerate(records)
    ]
    log = write(tmp_path / "stepped.mcap", episode, stepped)
    for line, status in (("train", 2), ("train --as-live", 0)):
        with pytest.raises(SystemExit) as end:
            app.main([*line.split(), str(log), "--out", str(tmp_path / "c.npz")])
        assert end.value.code == status
        complaint = capfd.readouterr().err.splitlines()
        if status:
            assert len(complaint) == 1
            assert complaint[0].endswith(
                "; log times fall in the order of the file, as of a clock that stepped back, and messages are taken "
                "by them: `reenact train --as-live` goes by the file"
            )
