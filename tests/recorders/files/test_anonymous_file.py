"""A file gets its name once it is whole and on the disk; whatever fails before leaves what was there, and no more."""

import errno
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from simulated_disk import Fault, SimulatedDisk

from recorders.files import disk
from recorders.files.anonymous_file import free_name, write_json, write_whole

UNNAMED = ["create_unnamed", "write", "sync", "give_name", "rename", "sync_folder", "close"]
NAMED = ["create", "write", "sync", "rename", "sync_folder", "close"]


@pytest.fixture(params=["files without a name", "names only"])
def steps(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """What is done, in order, on a file system that has files without a name, and on one that has none."""
    if request.param == "files without a name":
        return UNNAMED
    monkeypatch.setattr(SimulatedDisk, "create_unnamed", lacking)
    return NAMED


def lacking(*arguments: Any) -> None:
    """Fail as a file system does that has no files without a name."""
    raise OSError(errno.EOPNOTSUPP, "no files without a name")


def content(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_it_has_its_name_once_it_is_on_the_disk(tmp_path: Path, steps: list[str]) -> None:
    (tmp_path / "a").write_bytes(b"old")
    with SimulatedDisk(tmp_path).installed() as simulated:
        write_whole(tmp_path / "a", b"new")
        assert simulated.operations == steps
        assert simulated.open_files() == 0
    assert content(tmp_path) == {"a": b"new"}


def test_whatever_fails_before_leaves_the_old_one_and_nothing_else(tmp_path: Path, steps: list[str]) -> None:
    (tmp_path / "a").write_bytes(b"old")
    for at in range(1, steps.index("rename") + 1):
        with SimulatedDisk(tmp_path, Fault(at, "EIO")).installed() as simulated:
            with pytest.raises(OSError, match=r"\[Errno 5\]"):
                write_whole(tmp_path / "a", b"new")
            assert simulated.open_files() == 0
        assert content(tmp_path) == {"a": b"old"}, steps[at]


def test_a_name_that_another_takes_meanwhile_is_left_to_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def taken(function: Callable[..., Any], place: int) -> Callable[..., Any]:
        """Have another process take the name just before the first call."""

        def call(*arguments: Any) -> Any:
            first = tmp_path / "a.tmp1"
            if not first.exists():
                first.write_bytes(b"of another")
                assert arguments[place] == first
            return function(*arguments)

        return call

    monkeypatch.setattr(disk, "give_name", taken(disk.give_name, 1))
    write_whole(tmp_path / "a", b"new")
    assert content(tmp_path) == {"a": b"new", "a.tmp1": b"of another"}
    (tmp_path / "a.tmp1").unlink()
    monkeypatch.setattr(disk, "create_unnamed", lacking)
    monkeypatch.setattr(disk, "create", taken(disk.create, 0))
    write_whole(tmp_path / "a", b"newer")
    assert content(tmp_path) == {"a": b"newer", "a.tmp1": b"of another"}


def test_the_first_free_name_is_one_that_not_even_a_broken_link_has(tmp_path: Path) -> None:
    near = tmp_path / "a"
    assert free_name(near, ".tmp") == tmp_path / "a.tmp1"
    (tmp_path / "a.tmp1").touch()
    (tmp_path / "a.tmp2").symlink_to(tmp_path / "nothing")
    assert free_name(near, ".tmp") == tmp_path / "a.tmp3"


def test_json_is_for_readers_and_has_no_number_that_is_none(tmp_path: Path) -> None:
    write_json(tmp_path / "a.json", {"mean": 0.5, "parts": [1]})
    assert (tmp_path / "a.json").read_text() == '{\n  "mean": 0.5,\n  "parts": [\n    1\n  ]\n}\n'
    with pytest.raises(ValueError, match="not JSON compliant"):
        write_json(tmp_path / "a.json", {"mean": float("nan")})
    assert list(content(tmp_path)) == ["a.json"]
