"""The learner in a process of its own, fed over Zenoh on loopback, ends where training from the file ends."""

import json
import signal
import subprocess
import threading
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from episodes import Change, write_episode
from held_stream import PATIENCE_S, HeldStream
from here import reenact_here
from processes import complaint, reenact, start, wait_for_line
from sockets import listening, loopback
from waiting import wait_until

from pipeline.learner.controller import Controller
from pipeline.learner.rules.reservoir.config import LearnerConfig
from pipeline.robot.config import load_robot
from pipeline.training.checkpoints import CheckpointConfig
from pipeline.training.trainer import Trainer, train, train_on
from recorders.messages.message_types import JointState, Message, PoseStamped
from recorders.messages.record import RecordedMessage
from recorders.wire.loopback import free_endpoint
from recorders.wire.session import SessionConfig, open_session
from replay.sources.schedule import Schedule
from replay.sources.scheduled import Replay
from replay.transports.sender_config import SenderConfig
from replay.transports.zenoh import ZenohTransport

EPOCHS = 3


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_episode(tmp_path_factory.mktemp("nodes") / "log.mcap", samples=40)


@contextmanager
def learner(folder: Path, *options: object) -> Iterator[tuple[str, subprocess.Popen[str]]]:
    """Start a learner in an empty folder; yields its endpoint and its process."""
    endpoint = free_endpoint()
    with start("learn", "--listen", endpoint, "--out", "controller.npz", "--json", *options, cwd=folder) as process:
        yield endpoint, process
        process.kill()


@pytest.fixture
def empty(tmp_path: Path) -> Path:
    folder = tmp_path / "empty"
    folder.mkdir()
    return folder


@pytest.mark.parametrize(
    "options",
    [
        (),
        ("--window", 50, "--batch-size", 9),
        pytest.param(("--window", 1), marks=pytest.mark.campaign),
        pytest.param(("--window", 1024, "--batch-size", 64), marks=pytest.mark.campaign),
    ],
)
def test_over_zenoh_and_from_the_file_are_one_state(
    log: Path, empty: Path, tmp_path: Path, options: tuple[object]
) -> None:
    expected = train([log], schedule=Schedule(epochs=EPOCHS), config=LearnerConfig(seed=5)).result()
    with learner(empty, "--seed", 5) as (endpoint, process):
        arguments = ("replay", log, "--connect", endpoint, "--epochs", EPOCHS, "--wait", 60, "--json", *options)
        replayed = reenact(*arguments, cwd=tmp_path)
        assert replayed.returncode == 0, replayed.stderr
        learned, complaints = process.communicate(timeout=120)
    assert process.returncode == 0, complaints
    assert json.loads(replayed.stdout)["consumers"]["learner"] == expected
    assert json.loads(learned) == expected | {"controller": "controller.npz", "pairs": "commanded"}
    assert [entry.name for entry in empty.iterdir()] == ["controller.npz"]
    assert Controller.load(empty / "controller.npz").digest == expected["digest"]


def test_the_replay_may_listen_and_start_first(log: Path, empty: Path, tmp_path: Path) -> None:
    endpoint = free_endpoint()
    arguments = ("replay", log, "--listen", endpoint, "--epochs", 1, "--await", "anna", "--wait", 60, "--json")
    with start(*arguments, cwd=tmp_path) as replay:
        wait_until(lambda: loopback(endpoint) in listening(replay.pid))
        learned = reenact("learn", "--connect", endpoint, "--name", "anna", "--out", "c.npz", "--json", cwd=empty)
        replayed, complaints = replay.communicate(timeout=120)
    assert learned.returncode == 0, learned.stderr
    assert replay.returncode == 0, complaints
    assert json.loads(replayed)["consumers"]["anna"]["digest"] == json.loads(learned.stdout)["digest"]


def test_nobody_listening_is_one_clear_line(log: Path, tmp_path: Path) -> None:
    line = complaint(reenact_here("replay", log, "--connect", free_endpoint(), "--wait", 1, cwd=tmp_path))
    assert "nothing listens at tcp/127.0.0.1:" in line
    assert "reenact learn" in line


def test_a_log_that_is_cut_off_reaches_no_learner(log: Path, empty: Path, tmp_path: Path) -> None:
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(log.read_bytes()[:-2_000])
    with learner(empty) as (endpoint, process):
        line = complaint(reenact_here("replay", cut, "--connect", endpoint, cwd=tmp_path))
        assert "cut.mcap" in line
        assert process.poll() is None


def test_a_log_that_cannot_be_learned_from_is_named_before_anything_is_sent(empty: Path, tmp_path: Path) -> None:
    def spoil(tick: int, topic: str, message: Message) -> Sequence[tuple[str, Message]]:
        bad = tick == 7 and isinstance(message, PoseStamped)
        return [(topic, replace(message, position=np.full(3, np.nan)) if bad else message)]

    log = write_episode(tmp_path / "nan.mcap", samples=10, change=spoil)
    with learner(empty) as (endpoint, process):
        line = complaint(reenact_here("replay", log, "--connect", endpoint, "--wait", 60, cwd=tmp_path))
        assert "nan.mcap: /hand/left/target #7: expected finite numbers" in line
        assert process.poll() is None


def test_a_message_that_cannot_be_learned_from_ends_both_sides_with_its_name(empty: Path, tmp_path: Path) -> None:
    names = ("antenna", *load_robot("asimo").joints[1:])
    log = write_episode(tmp_path / "names.mcap", samples=10, change=at_tick_7(name=names))
    with learner(empty) as (endpoint, process):
        line = complaint(reenact_here("replay", log, "--connect", endpoint, "--wait", 60, cwd=tmp_path))
        _, complaints = process.communicate(timeout=120)
    assert "learner: names.mcap: /sample/joint_states #7: no joint hip_height in the message" in line
    assert process.returncode == 2
    assert complaints.splitlines()[-1].startswith("reenact: names.mcap: /sample/joint_states #7: no joint hip_height")


def at_tick_7(**changes: object) -> Change:
    def change(tick: int, topic: str, message: Message) -> Sequence[tuple[str, Message]]:
        spoilt = tick == 7 and isinstance(message, JointState)
        return [(topic, replace(message, **changes) if spoilt else message)]

    return change


def test_a_second_replay_is_refused_while_the_first_goes_on(log: Path, empty: Path, tmp_path: Path) -> None:
    source = Replay([log], Schedule(epochs=1))
    held = HeldStream(source, at=200)
    with learner(empty) as (endpoint, process), ThreadPoolExecutor() as pool:
        wait_for_line(process, "waits for a replay")
        with open_session(SessionConfig(connect=(endpoint,))) as session:
            transport = ZenohTransport(session, config=SenderConfig(wait_s=PATIENCE_S))
            first = pool.submit(transport.deliver, source.offer(), held.stream)
            assert held.reached.wait(PATIENCE_S)
            line = complaint(reenact_here("replay", log, "--connect", endpoint, "--wait", 60, cwd=tmp_path))
            assert "already fed by another replay" in line
            held.may_go_on.set()
            replayed = first.result(timeout=PATIENCE_S)
        learned, _ = process.communicate(timeout=120)
    assert json.loads(learned)["digest"] == replayed["learner"]["digest"]


def test_a_replay_that_is_stopped_tells_the_learner(log: Path, empty: Path, tmp_path: Path) -> None:
    with learner(empty) as (endpoint, process):
        with start("replay", log, "--connect", endpoint, "--epochs", 100_000, "--wait", 60, cwd=tmp_path) as replay:
            wait_for_line(process, "takes run")
            replay.send_signal(signal.SIGTERM)
            replay.communicate(timeout=120)
            assert replay.returncode == 128 + signal.SIGTERM
        _, complaints = process.communicate(timeout=120)
    assert process.returncode == 2
    assert "the sender gave up" in complaints


def test_a_learner_listens_on_loopback_alone_and_a_replay_nowhere(log: Path, empty: Path, tmp_path: Path) -> None:
    endless = ("replay", log, "--epochs", 100_000, "--wait", 60)
    with (
        learner(empty) as (endpoint, process),
        start(*endless, "--connect", endpoint, cwd=tmp_path) as replay,
    ):
        wait_for_line(process, "takes run")
        port = int(endpoint.rpartition(":")[2])
        assert listening(process.pid) == {f"tcp 0100007F:{port:04X}"}
        assert listening(replay.pid) == set()
        replay.kill()


def test_a_learner_that_is_killed_twice_goes_on_from_its_checkpoint(log: Path, empty: Path, tmp_path: Path) -> None:
    source, endpoint = Replay([log], Schedule(epochs=60)), free_endpoint()
    expected = train([log], schedule=Schedule(epochs=60), config=LearnerConfig(seed=5)).result()
    checkpointed = ("--checkpoint", "k.npz", "--checkpoint-every", 500)
    arguments = ("learn", "--connect", endpoint, "--out", "c.npz", "--seed", 5, *checkpointed)
    gates = {share * len(source) // 3: threading.Event() for share in (1, 2)}  # some 800 and 1600 of 2400 ticks

    def gated(begin: int) -> Iterator[RecordedMessage]:
        for index, message in enumerate(source.stream(begin), begin):
            assert index not in gates or gates[index].wait(PATIENCE_S)
            yield message

    config = SenderConfig(window=256, wait_s=PATIENCE_S, patience_s=PATIENCE_S)
    with open_session(SessionConfig(listen=(endpoint,))) as session, ThreadPoolExecutor() as pool:
        replayed = pool.submit(ZenohTransport(session, config=config).deliver, source.offer(), gated)
        beginnings = []
        for gate in gates.values():
            with start(*arguments, cwd=empty) as process:
                beginnings.append(int(wait_for_line(process, "takes run").split(" from message ")[1].split()[0]))
                wait_until(lambda: kept(empty / "k.npz") > beginnings[-1])
                process.kill()
            gate.set()
        last = reenact(*arguments, "--json", cwd=empty)
        assert last.returncode == 0, last.stderr
        assert replayed.result(timeout=120) == {"learner": expected}
    assert beginnings[0] == 0
    assert 0 < beginnings[1] < kept(empty / "k.npz")
    assert json.loads(last.stdout) == expected | {"controller": "c.npz", "pairs": "commanded"}


def kept(checkpoint: Path) -> int:
    """Return the stream index that a checkpoint goes on from; 0 if there is none yet."""
    return int(Controller.load(checkpoint).provenance["checkpoint"]["next"]) if checkpoint.exists() else 0


def test_a_checkpoint_of_another_run_is_refused(log: Path, empty: Path, tmp_path: Path) -> None:
    trainer = Trainer(LearnerConfig(), checkpoint=CheckpointConfig(empty / "k.npz", 10))
    train_on(Replay([log], Schedule(epochs=1)), trainer)
    with learner(empty, "--checkpoint", "k.npz") as (endpoint, process):
        line = complaint(reenact_here("replay", log, "--connect", endpoint, "--epochs", 2, "--wait", 60, cwd=tmp_path))
        assert "k.npz: expected a checkpoint of run" in line
        assert process.poll() is None


def test_paced_with_the_learner_awaited_it_is_the_same_state(log: Path, empty: Path, tmp_path: Path) -> None:
    expected = train([log], schedule=Schedule(epochs=1), config=LearnerConfig(seed=5)).result()
    with learner(empty, "--seed", 5) as (endpoint, process):
        arguments = ("replay", log, "--connect", endpoint, "--epochs", 1, "--rate", 50, "--wait", 60, "--json")
        replayed = reenact(*arguments, cwd=tmp_path)
        assert replayed.returncode == 0, replayed.stderr
        process.communicate(timeout=120)
    result = json.loads(replayed.stdout)
    assert result["consumers"]["learner"] == expected
    assert result["slipped_s"] >= 0.0


def test_two_hops_through_a_router_are_the_same_state(log: Path, empty: Path, tmp_path: Path) -> None:
    expected = train([log], schedule=Schedule(epochs=EPOCHS), config=LearnerConfig(seed=5)).result()
    endpoint = free_endpoint()
    with open_session(SessionConfig(listen=(endpoint,))):
        with start("learn", "--connect", endpoint, "--seed", 5, "--out", "c.npz", "--json", cwd=empty) as process:
            wait_for_line(process, "waits for a replay")
            arguments = ("replay", log, "--connect", endpoint, "--epochs", EPOCHS, "--wait", 60, "--json")
            replayed = reenact(*arguments, cwd=tmp_path)
            assert replayed.returncode == 0, replayed.stderr
            process.communicate(timeout=120)
    assert json.loads(replayed.stdout)["consumers"]["learner"] == expected


@pytest.mark.parametrize("stall_s", [1.0, pytest.param(8.0, marks=pytest.mark.campaign)])
def test_a_learner_that_stalls_loses_nothing(log: Path, empty: Path, tmp_path: Path, stall_s: float) -> None:
    epochs = 100
    expected = train([log], schedule=Schedule(epochs=epochs), config=LearnerConfig(seed=5)).result()
    with learner(empty, "--seed", 5) as (endpoint, process):
        arguments = ("replay", log, "--connect", endpoint, "--epochs", epochs, "--wait", 60, "--json")
        with start(*arguments, cwd=tmp_path) as replay:
            wait_for_line(process, "takes run")
            process.send_signal(signal.SIGSTOP)
            time.sleep(stall_s)  # no event: this is what befalls it
            process.send_signal(signal.SIGCONT)
            replayed, complaints = replay.communicate(timeout=120)
            assert replay.returncode == 0, complaints
        process.communicate(timeout=120)
    assert json.loads(replayed)["consumers"]["learner"] == expected
