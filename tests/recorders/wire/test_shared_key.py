"""The key of streams is the user's alone, or it is refused in one line that says what to do."""

import os
import stat
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from recorders.errors import ConfigError
from recorders.wire.shared_key import read_key, shared_key


@pytest.fixture
def runtime(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "run"
    folder.mkdir(mode=0o700)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(folder))
    return folder


@pytest.fixture
def state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A user without a folder of the run time."""
    monkeypatch.delenv("XDG_RUNTIME_DIR", raising=False)
    monkeypatch.setattr("recorders.wire.shared_key._runtime_folders", lambda: iter(()))
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    return tmp_path / "state"


def test_it_is_made_once_and_for_this_user_alone(runtime: Path) -> None:
    with ThreadPoolExecutor(8) as threads:
        keys = set(threads.map(lambda _: shared_key(), range(16)))
    assert len(keys) == 1
    (path,) = (runtime / "reenact").iterdir()
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert stat.S_IMODE(path.parent.stat().st_mode) == 0o700
    assert keys == {shared_key(), read_key(path)}


def test_without_a_folder_of_the_run_time_it_is_beside_other_state(state: Path) -> None:
    key = shared_key()
    assert read_key(state / "reenact" / "stream.key") == key
    assert stat.S_IMODE((state / "reenact").stat().st_mode) == 0o700


def test_a_folder_of_the_run_time_that_others_may_write_is_passed_over(runtime: Path, state: Path) -> None:
    runtime.chmod(0o777)
    shared_key()
    assert list(runtime.iterdir()) == []


def test_where_no_private_folder_can_be_made_one_line_names_the_option(
    state: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    state.touch()
    with pytest.raises(ConfigError, match=r"no private folder for the key of streams .*--key"):
        shared_key()


def test_a_planted_folder_or_key_is_refused(state: Path, tmp_path: Path) -> None:
    state.mkdir()
    (tmp_path / "planted").mkdir(mode=0o700)
    (state / "reenact").symlink_to(tmp_path / "planted")
    with pytest.raises(ConfigError, match="is a link"):
        shared_key()
    (state / "reenact").unlink()
    (state / "reenact").mkdir(mode=0o700)
    (tmp_path / "planted.key").write_text("ab" * 32)
    (tmp_path / "planted.key").chmod(0o600)
    (state / "reenact" / "stream.key").symlink_to(tmp_path / "planted.key")
    with pytest.raises(ConfigError, match="no link"):
        shared_key()


@pytest.mark.parametrize("mode", [0o640, 0o604, 0o620, 0o660])
def test_a_key_that_others_can_read_or_write_is_refused(tmp_path: Path, mode: int) -> None:
    path = tmp_path / "key"
    path.write_text("ab" * 32)
    path.chmod(mode)
    with pytest.raises(ConfigError, match=f"mode {mode:o}: chmod 600"):
        shared_key(path)
    path.chmod(0o600)
    assert shared_key(path) == bytes.fromhex("ab" * 32)


def test_a_key_of_another_user_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "key"
    path.write_text("ab" * 32)
    path.chmod(0o600)
    owner = os.geteuid()
    monkeypatch.setattr(os, "geteuid", lambda: owner + 1)
    with pytest.raises(ConfigError, match=f"found owner {owner}"):
        shared_key(path)


@pytest.mark.parametrize("text", ["", "ab" * 31, "ab" * 33, "xy" * 32, "ab" * 5000])
def test_what_is_no_key_is_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "key"
    path.write_text(text)
    path.chmod(0o600)
    with pytest.raises(ConfigError, match="expected 64 hexadecimal digits"):
        shared_key(path)


def test_what_is_no_file_is_refused(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe", 0o600)
    (tmp_path / "link").symlink_to(tmp_path / "none")
    found = {"none": "expected a file", "pipe": "regular file", "link": "no link", ".": "a directory"}
    for name, line in found.items():
        with pytest.raises(ConfigError, match=f"(?i){line}"):
            shared_key(tmp_path / name)
