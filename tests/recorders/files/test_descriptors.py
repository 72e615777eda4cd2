"""Too few file descriptors are one line before anything is opened; a soft limit is no limit."""

import resource
import subprocess
import sys
from pathlib import Path

import pytest
from processes import command, complaint

from pipeline.training.executors import local_processes
from recorders.errors import ConfigError
from recorders.files.descriptors import need_descriptors
from recorders.wire.loopback import free_endpoint


def limited(soft: int, hard: int, program: str) -> str:
    """Run a program of Python under limits; returns what it prints."""

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))

    run = subprocess.run([sys.executable, "-c", program], preexec_fn=limit, capture_output=True, text=True, check=True)
    return run.stdout


def test_a_soft_limit_is_raised_as_far_as_the_hard_one_allows() -> None:
    program = (
        "import resource; from recorders.files.descriptors import need_descriptors; need_descriptors(40, purpose='it');"
        "print(resource.getrlimit(resource.RLIMIT_NOFILE))"
    )
    assert limited(16, 200, program) == "(200, 200)\n"
    assert limited(16, 3000, program) == "(1024, 3000)\n"
    assert limited(2000, 3000, program) == "(2000, 3000)\n"


def test_more_than_there_can_be_is_one_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(resource, "getrlimit", lambda which: (64, 64))
    monkeypatch.setattr(resource, "setrlimit", lambda which, limits: None)
    with pytest.raises(ConfigError, match=r"it needs 64 file descriptors, expected a limit of at least \d+, found 64:"):
        need_descriptors(64, purpose="it")
    with pytest.raises(ConfigError, match="a pool of processes needs"), local_processes(5):
        pass


@pytest.mark.parametrize(
    ("verb", "limit"),
    [
        (("record", "--out", "x.mcap"), 12),
        (("record", "--out", "x.mcap"), 40),
        pytest.param(("robot",), 20, marks=pytest.mark.extra),
    ],
)
def test_a_verb_that_publishes_or_records_says_so_at_once(tmp_path: Path, verb: tuple[str, ...], limit: int) -> None:
    def few() -> None:
        resource.setrlimit(resource.RLIMIT_NOFILE, (limit, limit))

    run = subprocess.run(
        command(*verb, "--listen", free_endpoint()),
        cwd=tmp_path,
        preexec_fn=few,
        capture_output=True,
        text=True,
        check=False,
    )
    assert f"found {limit}: raise it, as by `ulimit -n 1024`" in complaint(run)
    assert list(tmp_path.iterdir()) == []
