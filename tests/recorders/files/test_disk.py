"""The calls by which files are written do what they say, on the operating system's own disk."""

import errno
import fcntl
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from recorders.files import disk


@contextmanager
def no_mask() -> Iterator[None]:
    """New files get all the permissions that they are made with."""
    before = os.umask(0)
    try:
        yield
    finally:
        os.umask(before)


def permissions(descriptor: int) -> int:
    return os.fstat(descriptor).st_mode & 0o777


def is_inherited(descriptor: int) -> bool:
    return not fcntl.fcntl(descriptor, fcntl.F_GETFD) & fcntl.FD_CLOEXEC


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def open_descriptors() -> list[str]:
    return names(Path("/proc/self/fd"))


def failing(code: int) -> Callable[..., None]:
    """Return a call that fails with an error of the operating system."""

    def call(*arguments: Any) -> None:
        raise OSError(code, os.strerror(code))

    return call


def test_a_new_file_is_written_to_and_of_this_process_alone(tmp_path: Path) -> None:
    path = tmp_path / "a"
    with no_mask(), disk.create(path) as file:
        assert permissions(file.fileno()) == 0o666
        assert not is_inherited(file.fileno())
        file.write(b"abc")
        file.flush()
        assert disk.read_at(file, 2, 1) == b"bc"
    with disk.open_to_read(path) as read:
        assert read.read() == b"abc"


@pytest.mark.parametrize("make", [Path.touch, lambda path: path.symlink_to("nothing")])
def test_a_name_that_is_taken_by_a_file_or_a_link_is_left(tmp_path: Path, make: Callable[[Path], None]) -> None:
    make(tmp_path / "a")
    before = os.lstat(tmp_path / "a")
    with pytest.raises(FileExistsError):
        disk.create(tmp_path / "a")
    assert os.lstat(tmp_path / "a") == before
    assert names(tmp_path) == ["a"]


def test_a_file_without_a_name_gets_one_where_none_is_taken(tmp_path: Path) -> None:
    descriptors = open_descriptors()
    with no_mask(), disk.create_unnamed(tmp_path) as file:
        assert permissions(file.fileno()) == 0o666
        assert not is_inherited(file.fileno())
        assert names(tmp_path) == []
        file.write(b"abc")
        disk.give_name(file, tmp_path / "a")
        with pytest.raises(FileExistsError):
            disk.give_name(file, tmp_path / "a")
    assert (tmp_path / "a").read_bytes() == b"abc"
    assert open_descriptors() == descriptors


def test_without_a_list_of_open_files_there_are_no_files_without_a_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(disk, "_OPEN_FILES", str(tmp_path / "nothing"))
    with pytest.raises(FileNotFoundError):
        disk.create_unnamed(tmp_path)


def test_a_file_that_is_opened_to_be_locked_is_as_it_is(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"abc")
    with disk.open_to_lock(tmp_path / "a") as file:
        assert not is_inherited(file.fileno())
        file.write(b"x")
        assert (tmp_path / "a").read_bytes() == b"xbc"
    (tmp_path / "link").symlink_to("a")
    with pytest.raises(OSError, match="symbolic link"):
        disk.open_to_lock(tmp_path / "link")
    os.mkfifo(tmp_path / "pipe")
    with disk.open_to_lock(tmp_path / "pipe") as pipe:
        assert pipe.read(1) is None  # nothing is there, and nothing waited for


def test_one_locks_a_file_or_a_folder_at_a_time(tmp_path: Path) -> None:
    (tmp_path / "a").touch()
    with disk.open_to_lock(tmp_path / "a") as one, disk.open_to_lock(tmp_path / "a") as other:
        assert disk.lock(one) is True
        with pytest.raises(BlockingIOError):
            disk.lock(other)
    descriptors = open_descriptors()
    with disk.locked_folder(tmp_path) as is_locked:
        assert is_locked is True
        with pytest.raises(BlockingIOError), disk.locked_folder(tmp_path):
            pass
    with disk.locked_folder(tmp_path):
        pass
    assert open_descriptors() == descriptors
    with pytest.raises(NotADirectoryError), disk.locked_folder(tmp_path / "a"):
        pass


def test_a_file_system_without_locks_is_none_that_fails(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for code in (errno.ENOLCK, errno.EOPNOTSUPP, errno.EINVAL):
        monkeypatch.setattr(fcntl, "flock", failing(code))
        with disk.locked_folder(tmp_path) as is_locked:
            assert is_locked is False
    monkeypatch.setattr(fcntl, "flock", failing(errno.EIO))
    with pytest.raises(OSError, match=r"\[Errno 5\]"), disk.locked_folder(tmp_path):
        pass


def test_files_and_folders_are_synced(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    synced: list[Path] = []
    monkeypatch.setattr(os, "fsync", lambda descriptor: synced.append(Path(f"/proc/self/fd/{descriptor}").readlink()))
    descriptors = open_descriptors()
    with disk.create(tmp_path / "a") as file:
        disk.sync(file)
    disk.sync_folder(tmp_path)
    disk.make_folders(tmp_path / "b" / "c")
    disk.make_folders(tmp_path / "b" / "c")
    assert synced == [tmp_path / "a", tmp_path, tmp_path, tmp_path / "b"]
    assert (tmp_path / "b" / "c").is_dir()
    assert open_descriptors() == descriptors


def test_a_folder_that_cannot_be_synced_is_none_that_fails(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for code in (errno.EINVAL, errno.EOPNOTSUPP, errno.ENOSYS):
        monkeypatch.setattr(os, "fsync", failing(code))
        disk.sync_folder(tmp_path)
    monkeypatch.setattr(os, "fsync", failing(errno.EIO))
    with pytest.raises(OSError, match=r"\[Errno 5\]"):
        disk.sync_folder(tmp_path)
    monkeypatch.setattr(os, "open", failing(errno.EACCES))
    disk.sync_folder(tmp_path)


def test_names_are_given_changed_and_taken_away(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"abc")
    disk.link(tmp_path / "a", tmp_path / "b")
    with pytest.raises(FileExistsError):
        disk.link(tmp_path / "a", tmp_path / "b")
    (tmp_path / "c").write_bytes(b"old")
    disk.rename(tmp_path / "b", tmp_path / "c")
    assert (tmp_path / "c").samefile(tmp_path / "a")
    disk.unlink(tmp_path / "a")
    disk.make_folder(tmp_path / "d")
    with pytest.raises(FileExistsError):
        disk.make_folder(tmp_path / "d")
    assert names(tmp_path) == ["c", "d"]
    disk.remove_folder(tmp_path / "d")
    assert names(tmp_path) == ["c"]


def test_a_folder_is_taken_away_with_all_in_it_and_nothing_that_it_links_to(tmp_path: Path) -> None:
    kept = tmp_path / "kept"
    (tmp_path / "a" / "b" / "c").mkdir(parents=True)
    kept.mkdir()
    (kept / "file").touch()
    (tmp_path / "a" / "b" / "file").touch()
    (tmp_path / "a" / "link").symlink_to(kept)
    disk.remove_tree(tmp_path / "a")
    disk.remove_tree(tmp_path / "a")
    assert names(tmp_path) == ["kept"]
    assert names(kept) == ["file"]
