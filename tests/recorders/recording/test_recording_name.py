"""Recordings without a name are called by the time in UTC, and parts that a crash left are in nobody's way."""

import fcntl
from itertools import islice
from pathlib import Path

import pytest

from recorders.errors import LogError, TakenError
from recorders.messages.message_types import PoseStamped
from recorders.messages.topics import LEFT_TARGET
from recorders.reading.parts import PART
from recorders.recording.file_name import recording_names
from recorders.writing.writer import LogWriter

NOW_NS = 1_795_663_466_999_999_999  # 2026-11-26 03:24:26 UTC, and nearly a second


def names(out: Path | None, *, splits: bool = False, overwrite: bool = False) -> list[str]:
    """Return the first two names."""
    found = recording_names(out, splits=splits, overwrite=overwrite, now_ns=NOW_NS)
    return [str(name) for name in islice(found, 2)]


def part(path: Path, number: int, *, more: bool) -> None:
    manifest = {PART: {"session": "a", "number": number, "more": more}}
    with LogWriter(path, manifest=manifest) as log:
        log.write(LEFT_TARGET, PoseStamped(0, [0.0, 0.0, 0.0]), log_time_ns=0)


def test_without_a_name_it_is_the_time_and_no_name_is_given_twice(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.chdir(tmp_path)
    first, second = "session_2026-11-26_03-24-26", "session_2026-11-26_03-24-27"
    assert names(None) == [f"{first}.mcap", f"{second}.mcap"]
    assert caplog.messages == []
    for taken in (f"{first}.mcap", f"{first}.mcap.part", f"{first}_000.mcap", f"{first}_007.mcap.part"):
        (tmp_path / taken).touch()
        assert names(None)[0] == f"{second}.mcap"
        (tmp_path / taken).unlink()
    (tmp_path / f"{first}.mcap").symlink_to("nowhere")
    assert names(None)[0] == f"{second}.mcap"


def test_a_name_that_is_told_is_kept(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    for options in ({}, {"splits": True}, {"splits": True, "overwrite": True}):
        assert names(tmp_path / "a.mcap", **options) == [str(tmp_path / "a.mcap")]
    assert caplog.messages == []
    part(tmp_path / "a_000.mcap", 0, more=False)
    assert names(tmp_path / "a.mcap", splits=True, overwrite=True) == [str(tmp_path / "a.mcap")]
    with pytest.raises(TakenError, match=r"a_000.mcap exists: choose another name, or --overwrite"):
        names(tmp_path / "a.mcap", splits=True)


def test_a_part_to_be_replaced_that_is_no_log_is_refused_before_anything_is_recorded(tmp_path: Path) -> None:
    part(tmp_path / "a_000.mcap", 0, more=True)
    (tmp_path / "a_001.mcap").write_text("precious")
    with pytest.raises(LogError, match=r"a_001.mcap: there is a file that is no log, which stays as it is"):
        names(tmp_path / "a.mcap", splits=True, overwrite=True)


@pytest.mark.parametrize("between", [False, True])
def test_parts_that_a_crash_left_stay_and_the_new_ones_have_the_time_in_their_names(
    tmp_path: Path, between: bool, caplog: pytest.LogCaptureFixture
) -> None:
    part(tmp_path / "a_000.mcap", 0, more=True)
    left = "a_000.mcap" if between else "a_001.mcap.part"  # it may be killed when one part is done and none begun
    (tmp_path / left).touch()
    found = names(tmp_path / "a.mcap", splits=True)
    assert found[0] == str(tmp_path / "a_2026-11-26_03-24-26.mcap")
    line = caplog.messages[0]
    assert line.startswith(f"{tmp_path / left} was left by a recording that did not come to its end, and stays")
    assert line.endswith("The parts of this one are called a_2026-11-26_03-24-26_*.mcap")


def test_parts_that_are_being_written_are_refused(tmp_path: Path) -> None:
    with (tmp_path / "a_000.mcap.part").open("wb") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        with pytest.raises(TakenError, match=r"a_000.mcap.part is being written by another recording"):
            names(tmp_path / "a.mcap", splits=True)
