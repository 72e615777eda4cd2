"""A session in parts is one session, however it is named; what is not all there is said in one line."""

import re
from pathlib import Path

import pytest
from episodes import write_episode
from sessions import split, write_foreign

from recorders.containers.opening import open_log
from recorders.errors import LogError
from recorders.messages.record import RecordedMessage
from recorders.reading.parts import Parts, find_log, is_log, one_session, part_path, parts_in, recordings
from recorders.reading.reader import LogReader
from recorders.recovery.recover import recover
from recorders.writing.writer import LogWriter


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_episode(tmp_path_factory.mktemp("whole") / "log.mcap", samples=12)


@pytest.fixture
def parts(log: Path, tmp_path: Path) -> list[Path]:
    return split(log, tmp_path / "session.mcap", (5, 6, 20))


def test_it_reads_as_the_log_in_one_piece_does_however_it_is_named(log: Path, parts: list[Path]) -> None:
    folder, whole = parts[0].parent, LogReader(log)
    for named in (folder, folder / "session.mcap", folder / "session", Parts(tuple(parts))):
        reader = open_log(named)
        assert list(reader) == list(whole)
        assert (reader.topics, reader.counts) == (whole.topics, whole.counts)
        assert [reader.attachment(name) for name in reader.attachments] == list(
            map(whole.attachment, whole.attachments)
        )
        assert reader.manifest == {"kind": "test"}
        assert reader.path.name == "session.mcap"
    assert one_session(list(reversed(parts))) == Parts(tuple(parts))


def test_parts_whose_names_were_swapped_go_by_what_they_say_of_themselves(log: Path, parts: list[Path]) -> None:
    aside = parts[0].rename(parts[0].with_suffix(".aside"))
    parts[2].rename(parts[0])
    aside.rename(parts[2])
    for session in (find_log(parts[0].parent), one_session(parts)):
        assert list(open_log(session)) == list(LogReader(log))


def test_slices_and_topics_are_those_of_the_whole(log: Path, parts: list[Path]) -> None:
    whole, reader = LogReader(log), open_log(Parts(tuple(parts)))
    times_ns = sorted({record.log_time_ns for record in whole})
    topic = next(iter(whole.topics))
    for begin, end in ((0, 5), (2, 3), (4, 9)):
        asked = {"start_ns": times_ns[begin], "end_ns": times_ns[end]}
        assert list(reader.records(topics=[topic], **asked)) == list(whole.records(topics=[topic], **asked))


@pytest.mark.parametrize("absent", [0, 1, 3])
def test_a_missing_part_is_named(parts: list[Path], absent: int) -> None:
    parts[absent].unlink()
    with pytest.raises(LogError, match=rf"session\.mcap: part {absent} is missing: expected parts 0 to 3, found "):
        find_log(parts[0].parent)


def test_a_missing_part_of_others_is_missed_between_two(log: Path, tmp_path: Path) -> None:
    parts = split(log, tmp_path / "session.mcap", (5, 6, 20), numbered=False)
    parts[0].unlink()
    assert find_log(tmp_path) == Parts(tuple(parts[1:]))
    parts[2].unlink()
    with pytest.raises(LogError, match=r"part 2 is missing"):
        find_log(tmp_path / "session.mcap")


def test_parts_of_two_sessions_are_none(log: Path, parts: list[Path]) -> None:
    with LogWriter(parts[3], manifest={"part": {"session": "another", "number": 3, "more": False}}, overwrite=True):
        pass
    with pytest.raises(LogError, match="expected the parts of one session, found those of several"):
        one_session(parts)


def test_a_part_that_was_cut_off_is_to_be_recovered_first(log: Path, parts: list[Path]) -> None:
    part, mended = parts[3].with_name(f"{parts[3].name}.part"), parts[3].with_name(f"recovered_{parts[3].name}")
    part.write_bytes(parts[3].read_bytes()[:-100])
    aside = parts[3].with_name("session_000.mcap.part.0001")  # what a crash left of another recording
    aside.write_bytes(parts[0].read_bytes())
    parts[3].unlink()
    line = f"`reenact recover {part} --out {mended} && mv {mended} {parts[3]}` brings back what is whole"
    with pytest.raises(LogError, match=re.escape(line)):
        find_log(parts[0].parent)
    recover(part, mended)
    mended.rename(parts[3])
    assert find_log(parts[0].parent) == Parts(tuple(parts))
    assert list(open_log(parts[0].parent)) == list(LogReader(log))


def test_old_numbers_are_read_as_numbers(log: Path, tmp_path: Path) -> None:
    parts = split(log, tmp_path / "session.mcap", range(1, 11), numbered=False)
    old = [part.rename(tmp_path / f"session_{number}.mcap") for number, part in enumerate(parts)]
    assert sorted(old) != old
    assert one_session(sorted(old)) == Parts(tuple(old))
    assert list(open_log(tmp_path / "session")) == list(LogReader(log))


def test_a_thousand_parts_sort_by_name() -> None:
    paths = [part_path(Path("session.mcap"), number).name for number in range(1000)]
    assert sorted(paths) == paths


def test_parts_of_others_that_overlap_are_merged_by_time(tmp_path: Path) -> None:
    def message(number: int) -> RecordedMessage:
        return RecordedMessage(f"/{number % 2}", "std_msgs/msg/String", b"\0\1\0\0\1\0\0\0\0", number, 2**63 + number)

    names = {"a.mcap": (0, 1, 5, 6), "b.mcap": (2, 3, 8, 9), "c.mcap": (4, 7, 10)}
    paths = [write_foreign(tmp_path / name, list(map(message, numbers))) for name, numbers in names.items()]
    assert list(open_log(one_session(paths))) == list(map(message, range(11)))


def test_recordings_are_grouped_by_session_and_keep_their_order(
    log: Path, parts: list[Path], caplog: pytest.LogCaptureFixture
) -> None:
    assert recordings([parts[2], parts[0], log, parts[1], parts[3], log]) == [
        Parts(tuple(parts)),
        log,
        log,
    ]
    assert caplog.messages == []


def test_a_part_alone_is_that_part_and_said_to_be_one(parts: list[Path], caplog: pytest.LogCaptureFixture) -> None:
    assert recordings([parts[1]]) == [parts[1]]
    assert caplog.messages == [
        f"{parts[1]} is one part of a session, taken alone; session.mcap beside it names them all"
    ]


def test_a_folder_of_several_recordings_is_none(log: Path, parts: list[Path]) -> None:
    (parts[0].parent / "other.mcap").write_bytes(log.read_bytes())
    with pytest.raises(LogError, match=r"one session in the folder, found other\.mcap, session_000"):
        find_log(parts[0].parent)


def test_a_folder_without_a_log_is_none(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("nothing")
    with pytest.raises(LogError, match="found no MCAP file in it"):
        find_log(tmp_path)


@pytest.mark.parametrize("name", ["log", "log.MCAP", "log.mcap.part", "log.csv"])
def test_a_log_is_told_by_its_first_bytes(log: Path, tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    path.write_bytes(log.read_bytes())
    assert is_log(path)
    path.write_bytes(b"t,lx,ly,lz\n")
    assert is_log(path) == (name == "log.MCAP")


def test_numbers_that_are_far_apart_are_one_line_at_once(tmp_path: Path) -> None:
    for number in (0, 999_999_999):
        write_foreign(tmp_path / f"a_{number}.mcap", [])
    with pytest.raises(LogError, match=r"part 1 is missing: expected parts 0 to 999999999, found 0, 999999999"):
        find_log(tmp_path)


def test_a_part_with_both_names_is_one(tmp_path: Path) -> None:
    for number in range(2):
        with LogWriter(tmp_path / f"session_{number:03d}.mcap", manifest={}):
            pass
    (tmp_path / "session_001.mcap.part").hardlink_to(tmp_path / "session_001.mcap")
    (tmp_path / "session_002.mcap.part").touch()
    names = [path.name for path in parts_in(tmp_path, "session")]
    assert names == ["session_000.mcap", "session_001.mcap", "session_002.mcap.part"]
