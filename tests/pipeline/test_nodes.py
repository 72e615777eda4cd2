"""The learner in a process of its own, fed over Zenoh on loopback, ends where training from the file ends."""

import json
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from episodes import write_episode
from processes import complaint, reenact, start

from pipeline.controller import Controller
from pipeline.learner import LearnerConfig
from pipeline.training import train
from recorders.wire.loopback import free_endpoint
from replay.schedule import Schedule

EPOCHS = 3


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_episode(tmp_path_factory.mktemp("nodes") / "log.mcap", samples=40)


@contextmanager
def learner(folder: Path, *options: object) -> Iterator[tuple[str, object]]:
    """Start a learner in an empty folder; yields its endpoint and its process."""
    endpoint = free_endpoint()
    with start("learn", "--listen", endpoint, "--out", "controller.npz", "--json", *options, cwd=folder) as process:
        try:
            yield endpoint, process
        finally:
            process.kill()


@pytest.fixture
def empty(tmp_path: Path) -> Path:
    folder = tmp_path / "empty"
    folder.mkdir()
    return folder


@pytest.mark.parametrize(
    "options", [(), ("--window", 1), ("--window", 1024, "--batch", 64), ("--window", 50, "--batch", 9)]
)
def test_over_zenoh_and_from_the_file_are_one_state(
    log: Path, empty: Path, tmp_path: Path, options: tuple[object]
) -> None:
    expected = train([log], schedule=Schedule(epochs=EPOCHS), config=LearnerConfig(seed=5)).result()
    with learner(empty, "--seed", 5) as (endpoint, process):
        arguments = ("replay", log, "--connect", endpoint, "--epochs", EPOCHS, "--wait", 60, "--json", *options)
        replayed = reenact(*arguments, cwd=tmp_path)
        assert replayed.returncode == 0, replayed.stderr
        learned, complaints = process.communicate(timeout=60)
    assert process.returncode == 0, complaints
    assert json.loads(replayed.stdout)["consumers"]["learner"] == expected
    assert json.loads(learned) == expected | {"controller": "controller.npz"}
    assert [entry.name for entry in empty.iterdir()] == ["controller.npz"]
    assert Controller.load(empty / "controller.npz").digest == expected["digest"]


def test_the_replay_may_listen_and_start_first(log: Path, empty: Path, tmp_path: Path) -> None:
    endpoint = free_endpoint()
    arguments = ("replay", log, "--listen", endpoint, "--epochs", 1, "--await", "anna", "--wait", 60, "--json")
    with start(*arguments, cwd=tmp_path) as replay:
        time.sleep(2.0)
        learned = reenact("learn", "--connect", endpoint, "--name", "anna", "--out", "c.npz", "--json", cwd=empty)
        replayed, complaints = replay.communicate(timeout=60)
    assert learned.returncode == 0, learned.stderr
    assert replay.returncode == 0, complaints
    assert json.loads(replayed)["consumers"]["anna"]["digest"] == json.loads(learned.stdout)["digest"]


def test_nobody_listening_is_one_clear_line(log: Path, tmp_path: Path) -> None:
    line = complaint(reenact("replay", log, "--connect", free_endpoint(), "--wait", 1, cwd=tmp_path))
    assert "no consumer named 'learner' answered within 1 s" in line
    assert "reenact learn" in line


def test_a_log_that_is_cut_off_reaches_no_learner(log: Path, empty: Path, tmp_path: Path) -> None:
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(log.read_bytes()[:-2_000])
    with learner(empty) as (endpoint, process):
        line = complaint(reenact("replay", cut, "--connect", endpoint, cwd=tmp_path))
        assert "cut.mcap" in line
        assert process.poll() is None


def test_a_message_that_cannot_be_learned_from_ends_both_sides_with_its_name(empty: Path, tmp_path: Path) -> None:
    from dataclasses import replace

    import numpy as np

    from recorders.messages import JointState

    def spoil(tick, topic, message):  # type: ignore[no-untyped-def]
        if tick == 7 and isinstance(message, JointState):
            message = replace(message, position=np.full(15, np.nan))
        return [(topic, message)]

    log = write_episode(tmp_path / "nan.mcap", samples=10, change=spoil)
    with learner(empty) as (endpoint, process):
        line = complaint(reenact("replay", log, "--connect", endpoint, "--wait", 60, cwd=tmp_path))
        _, complaints = process.communicate(timeout=60)
    assert "learner: /sample/joint_states #7" in line
    assert process.returncode == 2
    assert complaints.splitlines()[-1].startswith("reenact: /sample/joint_states #7: expected finite numbers")


def test_a_second_replay_is_refused_while_the_first_goes_on(log: Path, empty: Path, tmp_path: Path) -> None:
    with learner(empty) as (endpoint, process):
        first_arguments = ("replay", log, "--connect", endpoint, "--epochs", 400, "--wait", 60, "--json")
        with start(*first_arguments, cwd=tmp_path) as first:
            assert process.stderr is not None
            assert "waits for a replay" in process.stderr.readline()
            time.sleep(4.0)
            line = complaint(reenact("replay", log, "--connect", endpoint, "--wait", 5, cwd=tmp_path))
            assert "already fed by another replay" in line
            replayed, complaints = first.communicate(timeout=120)
            assert first.returncode == 0, complaints
        learned, _ = process.communicate(timeout=60)
    assert json.loads(learned)["digest"] == json.loads(replayed)["consumers"]["learner"]["digest"]


def test_a_replay_that_is_stopped_tells_the_learner(log: Path, empty: Path, tmp_path: Path) -> None:
    with learner(empty) as (endpoint, process):
        with start("replay", log, "--connect", endpoint, "--epochs", 100_000, "--wait", 60, cwd=tmp_path) as replay:
            time.sleep(6.0)
            replay.send_signal(signal.SIGTERM)
            replay.communicate(timeout=30)
            assert replay.returncode == 128 + signal.SIGTERM
        _, complaints = process.communicate(timeout=60)
    assert process.returncode == 2
    assert "the sender gave up" in complaints


def listening(pid: int) -> set[str]:
    """Addresses on which a process listens over TCP, and those of its UDP sockets."""
    sockets = {
        Path(entry).readlink().name.removeprefix("socket:[").removesuffix("]")
        for entry in Path(f"/proc/{pid}/fd").iterdir()
        if Path(entry).is_symlink() and str(Path(entry).readlink()).startswith("socket:[")
    }
    found = set()
    for table, states in (("tcp", {"0A"}), ("tcp6", {"0A"}), ("udp", {"07"}), ("udp6", {"07"})):
        for line in Path(f"/proc/{pid}/net/{table}").read_text().splitlines()[1:]:
            fields = line.split()
            if fields[9] in sockets and fields[3] in states:
                found.add(f"{table} {fields[1]}")
    return found


def test_a_learner_listens_on_loopback_alone_and_a_replay_nowhere(log: Path, empty: Path, tmp_path: Path) -> None:
    endless = ("replay", log, "--epochs", 100_000, "--wait", 60)
    with (
        learner(empty) as (endpoint, process),
        start(*endless, "--connect", endpoint, cwd=tmp_path) as replay,
    ):
        time.sleep(6.0)
        port = int(endpoint.rpartition(":")[2])
        assert listening(process.pid) == {f"tcp 0100007F:{port:04X}"}
        assert listening(replay.pid) == set()
        replay.kill()
