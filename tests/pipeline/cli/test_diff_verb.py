"""`diff` and a replay against a recorded run stop at the message in which two runs part, with exit status 1."""

import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from episodes import Change, write_episode
from here import reenact_here
from processes import reenact, start

from pipeline.learner.rules.reservoir.config import LearnerConfig
from pipeline.training.trainer import train
from recorders.messages.message_types import JointState, Message
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import LEFT_TARGET, SAMPLE_JOINTS
from recorders.reading.reader import LogReader
from recorders.wire.loopback import free_endpoint
from recorders.writing.writer import LogWriter
from replay.sources.schedule import Schedule
from replay.sources.scheduled import Replay

SAMPLES = 12


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_episode(tmp_path_factory.mktemp("diff") / "log.mcap", samples=SAMPLES)


def copied(log: Path, path: Path, edit: Callable[[list[RecordedMessage]], list[RecordedMessage]]) -> Path:
    with LogWriter(path, manifest={}) as writer:
        for record in edit(list(LogReader(log))):
            writer.copy(record)
    return path


def nudge_at(tick: int) -> Change:
    def change(at: int, topic: str, message: Message) -> Sequence[tuple[str, Message]]:
        if at == tick and isinstance(message, JointState):
            position = message.position.copy()
            position[3] = np.nextafter(position[3], 1.0)
            message = replace(message, position=position)
        return [(topic, message)]

    return change


def test_equal_logs_are_equal(log: Path, tmp_path: Path) -> None:
    same = copied(log, tmp_path / "same.mcap", lambda records: records)
    run = reenact_here("diff", log, same, cwd=tmp_path)
    assert (run.returncode, run.stdout) == (0, "no divergence\n")


def test_messages_of_one_tick_that_arrive_swapped_are_no_divergence(log: Path, tmp_path: Path) -> None:
    def swap(records: list[RecordedMessage]) -> list[RecordedMessage]:
        return [*records[:9], records[11], records[9], records[10], *records[12:]]

    swapped = copied(log, tmp_path / "swapped.mcap", swap)
    assert reenact_here("diff", log, swapped, cwd=tmp_path).returncode == 0


def test_the_last_bit_of_one_float_is_named(log: Path, tmp_path: Path) -> None:
    other = write_episode(tmp_path / "other.mcap", samples=SAMPLES, change=nudge_at(7))
    run = reenact_here("diff", log, other, "--json", cwd=tmp_path)
    assert run.returncode == 1
    found = json.loads(run.stdout)["first_divergence"]
    assert (found["topic"], found["sequence"], found["stamp_ns"]) == (SAMPLE_JOINTS, 7, 7 * 200_000_000)
    assert found["field"].startswith("position[3]")
    assert found["a"] != found["b"]


@pytest.mark.parametrize(
    ("edit", "sequence"),
    [
        (lambda records: records[:15] + records[16:], 5),
        (lambda records: [*records[:16], records[15], *records[16:]], 5),
        (lambda records: [*records[:15], records[18], records[16], records[17], records[15], *records[19:]], 5),
    ],
    ids=["dropped", "repeated", "swapped with another tick's"],
)
def test_a_message_out_of_its_place_is_named(
    log: Path, tmp_path: Path, edit: Callable[[list[RecordedMessage]], list[RecordedMessage]], sequence: int
) -> None:
    run = reenact_here("diff", log, copied(log, tmp_path / "other.mcap", edit), cwd=tmp_path)
    assert run.returncode == 1
    assert run.stdout.startswith(f"{LEFT_TARGET} #{sequence} at 1000000000 ns")


def test_controllers_are_compared_by_element(log: Path, tmp_path: Path) -> None:
    for seed in (0, 1):
        trained = train([log], schedule=Schedule(epochs=1), config=LearnerConfig(reservoir=20, seed=0))
        controller = trained.controller()
        if seed:
            state = dict(controller.state)
            state["b"] = state["b"].copy()
            state["b"][4] += 1e-9
            controller = replace(controller, state=state)
        controller.save(tmp_path / f"{seed}.npz")
    assert reenact_here("diff", "0.npz", "0.npz", cwd=tmp_path).returncode == 0
    run = reenact_here("diff", "0.npz", "1.npz", cwd=tmp_path)
    assert run.returncode == 1
    assert run.stdout.startswith("b[4]: ")


def test_a_log_and_a_controller_cannot_be_compared(log: Path, tmp_path: Path) -> None:
    (tmp_path / "c.npz").write_bytes(b"")
    run = reenact_here("diff", log, "c.npz", cwd=tmp_path)
    assert run.returncode == 2
    assert len(run.stderr.splitlines()) == 1


def recorded_run(log: Path, path: Path) -> Path:
    """Write what a recorder of the whole replay would have: every message of the run, markers included."""
    with LogWriter(path, manifest={}) as writer:
        for record in Replay([log], Schedule(epochs=1)).stream():
            writer.copy(record)
    return path


def test_a_replay_against_its_recorded_run_agrees_or_stops_where_they_part(log: Path, tmp_path: Path) -> None:
    recorded = recorded_run(log, tmp_path / "run.mcap")
    other = write_episode(tmp_path / "other.mcap", samples=SAMPLES)
    for path, status in ((other, 0), (changed(recorded, tmp_path / "changed.mcap"), 1)):
        against = path if status else recorded
        endpoint = free_endpoint()
        with start("learn", "--listen", endpoint, "--out", f"{status}.npz", cwd=tmp_path) as learner:
            run = reenact(
                "replay",
                log,
                "--epochs",
                1,
                "--connect",
                endpoint,
                "--wait",
                60,
                "--compare-with",
                against,
                cwd=tmp_path,
            )
            learner.communicate(timeout=120)
        assert run.returncode == status, run.stderr
    assert run.stderr.splitlines()[-1].startswith("reenact: /hand/left/target #5 at 1000000000 ns")


def changed(recorded: Path, path: Path) -> Path:
    """Copy a run with one target moved in its third cycle."""

    def edit(records: list[RecordedMessage]) -> list[RecordedMessage]:
        place = [n for n, record in enumerate(records) if record.topic == LEFT_TARGET][2 * (SAMPLES + 1) + 5]
        data = bytearray(records[place].data)
        data[-8 * 6] ^= 1
        records[place] = records[place]._replace(data=bytes(data))
        return records

    return copied(recorded, path, edit)
