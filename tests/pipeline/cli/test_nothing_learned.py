"""A training in which nothing is learned ends with status 2 and one line, and writes no controller."""

import shlex
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pytest
from episodes import write_episode

from pipeline.cli import app
from pipeline.robot.config import load_robot
from recorders.messages.message_types import Message, PoseStamped
from recorders.messages.phase import EVALUATE, LEARN, WASHOUT, Phase
from recorders.messages.topics import SESSION_PHASE
from recorders.reading.reader import LogReader
from recorders.writing.writer import LogWriter
from replay.sources.schedule import Schedule

ASIMO = load_robot("asimo")


def write_session(path: Path, episode: Path, *, phases: Sequence[str], ticks: int) -> None:
    """Write a session of one epoch, whose cycles present the first ticks of an episode."""
    records = [record for record in LogReader(episode) if record.topic != SESSION_PHASE][: 3 * ticks]
    files = {"robot.urdf": ASIMO.urdf_text.encode(), "robot.toml": ASIMO.toml_text.encode()}
    manifest = {"kind": "test", "schedule": Schedule(epochs=1).to_dict()}
    with LogWriter(path, manifest=manifest, attachments=files) as writer:
        for cycle, phase in enumerate(phases):
            marker = Phase("ab" * 16, 0, cycle, phase, log="").to_message()
            writer.write(SESSION_PHASE, marker, log_time_ns=cycle * 10**12)
            for record in records:
                sequence = record.sequence + cycle * ticks
                time_ns = cycle * 10**12 + record.log_time_ns
                writer.write(record.topic, record.data, log_time_ns=time_ns, sequence=sequence)


def in_millimetres(tick: int, topic: str, message: Message) -> Sequence[tuple[str, Message]]:
    if isinstance(message, PoseStamped):
        message = replace(message, position=message.position * 1000.0)
    return [(topic, message)]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with logs that hold nothing to learn."""
    folder = tmp_path_factory.mktemp("nothing")
    whole = write_episode(folder / "whole.mcap", samples=8)
    write_episode(folder / "one_tick.mcap", samples=0)
    write_episode(folder / "millimetres.mcap", samples=8, change=in_millimetres)
    write_session(folder / "evaluated.mcap", whole, phases=[WASHOUT, EVALUATE], ticks=9)
    write_session(folder / "marked_at_every_tick.mcap", whole, phases=[LEARN] * 4, ticks=1)
    (folder / "learner.toml").write_text("reservoir = 20\n")
    return folder


@pytest.mark.parametrize(
    ("line", "why"),
    [
        ("train one_tick.mcap --epochs 2 --out new.npz", "14 ticks"),
        ("train one_tick.mcap --as-live --out new.npz", "found 1 of them"),
        (
            "train millimetres.mcap --as-live --out new.npz",
            "found none; refused 18, given up 9; the first: /hand",
        ),
        ("train evaluated.mcap --as-recorded --out new.npz", "16 steps, all in other phases"),
        ("train evaluated.mcap --as-live --out new.npz", "16 steps, all in other phases"),
        ("train marked_at_every_tick.mcap --as-recorded --out new.npz", "4 ticks, no two that make a step"),
        ("golden add one_tick.mcap --config learner.toml --cases golden --name new", "nothing was learned"),
        ("golden add evaluated.mcap --as-recorded --config learner.toml --cases golden --name new", "other phases"),
    ],
)
def test_it_is_one_line_and_nothing_is_written(
    folder: Path, line: str, why: str, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(folder)
    with pytest.raises(SystemExit) as end:
        app.main(shlex.split(line))
    printed = capfd.readouterr()
    assert (end.value.code, printed.out) == (2, "")
    assert why in printed.err.splitlines()[-1]
    assert not (folder / "new.npz").exists()
    assert not (folder / "golden/new").exists()


def test_one_step_is_enough(folder: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    log = write_episode(tmp_path / "two_ticks.mcap", samples=1)
    with pytest.raises(SystemExit) as end:
        app.main(["train", str(log), "--epochs", "1", "--out", str(tmp_path / "new.npz")])
    assert end.value.code == 0
    assert (tmp_path / "new.npz").exists()
