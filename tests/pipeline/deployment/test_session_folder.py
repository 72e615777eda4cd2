"""Folders of sessions: taken away at the end, or by the next session where that was killed; nobody else's ever."""

import os
import tempfile
from pathlib import Path

import pytest

from pipeline.deployment.session_folder import OWNER, remove_abandoned, session_folder


@pytest.fixture(autouse=True)
def temporary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    return tmp_path


def left(temporary: Path, name: str = "reenact-left") -> Path:
    """Return a folder as a session leaves it that was killed."""
    folder = temporary / name
    folder.mkdir()
    (folder / OWNER).touch()
    (folder / "robot").mkdir()
    (folder / "robot" / "robot.toml").touch()
    return folder


def test_a_folder_is_there_while_its_session_runs() -> None:
    with session_folder() as folder:
        (folder / "file").touch()
        with session_folder() as other:
            assert folder != other
            assert (folder / "file").is_file()
        assert not other.exists()
        assert folder.is_dir()
    assert not folder.exists()


def test_what_a_killed_session_left_is_taken_away_by_the_next(temporary: Path) -> None:
    folder = left(temporary)
    with session_folder():
        assert not folder.exists()


def test_a_recording_that_a_killed_session_left_is_named_and_stays(temporary: Path, caplog) -> None:
    log = left(temporary) / "recorded_1.mcap.part"
    log.write_bytes(b"recorded")
    remove_abandoned()
    assert log.read_bytes() == b"recorded"
    assert caplog.messages == [f"{log}: a session that was killed was recording this; move or delete {log.parent}"]


def test_what_is_no_session_of_this_user_stays(temporary: Path) -> None:
    elsewhere = temporary / "elsewhere"
    elsewhere.mkdir()
    (elsewhere / OWNER).touch()
    (temporary / "reenact-link").symlink_to(elsewhere)
    (temporary / "reenact-file").touch()
    (temporary / "reenact-nobody").mkdir()
    begun = temporary / "reenact-begun"
    begun.mkdir()
    (begun / f"{OWNER}.new").touch()
    linked = temporary / "reenact-linked"
    linked.mkdir()
    (linked / OWNER).symlink_to(elsewhere / OWNER)
    if os.geteuid() == 0:
        os.chown(left(temporary, "reenact-another"), 12345, -1)
    before = sorted(temporary.rglob("*"))
    remove_abandoned()
    assert sorted(temporary.rglob("*")) == before
