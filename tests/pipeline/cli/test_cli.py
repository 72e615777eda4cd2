"""The command line: one clear line and status 2 for bad input, an example in every help, JSON that is JSON."""

import json
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from episodes import write_episode
from processes import complaint, reenact

from pipeline.cli import app
from pipeline.learner.rules.reservoir.config import LearnerConfig
from pipeline.training.trainer import train
from recorders.messages.message_types import JointState, Message
from recorders.messages.topics import JOINT_STATES, SAMPLE_JOINTS
from replay.sources.schedule import Schedule

VERBS = ("demo", "explore", "robot", "record", "train", "learn", "replay", "serve", "evaluate", "diff")


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a log, a controller, and one of every kind of bad input."""
    folder = tmp_path_factory.mktemp("cli")
    log = write_episode(folder / "log.mcap", samples=8)
    train([log], schedule=Schedule(epochs=1), config=LearnerConfig()).controller().save(folder / "controller.npz")
    (folder / "text.mcap").write_text("this is no log\n")
    (folder / "empty.mcap").write_bytes(b"")
    (folder / "cut.mcap").write_bytes(log.read_bytes()[:9_000])
    (folder / "folder.mcap").mkdir()
    (folder / "text.npz").write_text("this is no controller\n")
    header = "t,lx,ly,lz,rx,ry,rz\n"
    (folder / "nan.csv").write_text(header + "0,0.3,0.2,0.7,0.3,-0.2,0.7\n1,nan,0.2,0.7,0.3,-0.2,0.7\n")
    (folder / "far.csv").write_text(header + "0,0.3,0.2,0.7,0.3,-0.2,0.7\n1,2.0,0.2,0.7,0.3,-0.2,0.7\n")
    (folder / "columns.csv").write_text("t,x\n0,1\n")

    def change(edit):
        def changed(tick: int, topic: str, message: Message) -> Sequence[tuple[str, Message]]:
            return [edit(topic, message) if isinstance(message, JointState) else (topic, message)]

        return changed

    def renamed(topic: str, joints: JointState) -> tuple[str, Message]:
        return topic, replace(joints, name=("antenna", *joints.name[1:]))

    def spoilt(topic: str, joints: JointState) -> tuple[str, Message]:
        return topic, replace(joints, position=np.full(len(joints.name), np.nan))

    def elsewhere(topic: str, joints: JointState) -> tuple[str, Message]:
        assert topic == SAMPLE_JOINTS
        return JOINT_STATES, joints

    write_episode(folder / "names.mcap", samples=3, change=change(renamed))
    write_episode(folder / "nan.mcap", samples=3, change=change(spoilt))
    write_episode(folder / "jointless.mcap", samples=3, change=change(elsewhere))
    return folder


BAD_INPUT = [
    ("train nowhere.mcap --out c.npz", "nowhere.mcap: no such file"),
    ("train folder.mcap --out c.npz", "folder.mcap: expected a log, or the parts of a session in a folder"),
    ("train text.mcap --out c.npz", "text.mcap: expected an MCAP file"),
    ("train empty.mcap --out c.npz", "empty.mcap: expected an MCAP file, found an empty one"),
    ("train cut.mcap --out c.npz", "cut.mcap: "),
    ("train jointless.mcap --out c.npz", "jointless.mcap: expected messages on /sample/joint_states"),
    ("train names.mcap --out c.npz", "no joint hip_height in the message; there are: antenna"),
    ("train nan.mcap --out c.npz", "/sample/joint_states #0: expected hip_height near its limits"),
    ("train log.mcap --epochs 1 --out nowhere/c.npz", "nowhere/c.npz"),
    ("train log.mcap", "--out"),
    ("train log.mcap --out c.npz --epochs 0", "--epochs"),
    ("evaluate nowhere.npz log.mcap", "nowhere.npz"),
    ("evaluate text.npz log.mcap", "text.npz"),
    ("evaluate controller.npz nowhere.mcap", "nowhere.mcap: no such file"),
    ("evaluate controller.npz spiral", "unknown motion 'spiral'"),
    ("evaluate controller.npz nan.csv", "nan.csv', line 3, column lx"),
    ("evaluate controller.npz columns.csv", "columns.csv"),
    ("evaluate controller.npz eight --linear-from nowhere.mcap", "nowhere.mcap: no such file"),
    ("evaluate controller.npz eight --deploy --linear-from log.mcap", "expected one of --deploy and --linear-from"),
    ("evaluate controller.npz log.mcap --deploy", "or a CSV file, found the log log.mcap"),
    ("evaluate controller.npz spiral --deploy", "unknown motion 'spiral'"),
    ("evaluate log.mcap eight", "cannot use controller log.mcap: expected a controller (.npz), found a log (MCAP)"),
    (
        "evaluate controller.npz controller.npz",
        "expected CSV text in UTF-8, found a zip archive, as a controller (.npz)",
    ),
    ("serve log.mcap", "cannot use controller log.mcap: expected a controller (.npz), found a log (MCAP)"),
    ("train controller.npz --out c.npz", ": a zip archive, as a controller (.npz) is"),
    ("explore --motion log.mcap --out e.mcap", "'log.mcap': expected CSV text in UTF-8, found a log (MCAP)"),
    (
        "explore --motion eight --out controller.npz --overwrite",
        "controller.npz: there is a file that is no log, which",
    ),
    ("golden add log.mcap --config log.mcap --name a --cases .", "expected TOML in UTF-8, found a log (MCAP)"),
    ("explore --motion spiral --out e.mcap", "unknown motion 'spiral': expected one of circles, eight, volume"),
    ("explore --motion circels --out e.mcap", "did you mean circles?"),
    ("explore --motion far.csv --out e.mcap", "reach"),
    ("explore --motion nan.csv --out e.mcap", "nan.csv', line 3, column lx"),
    ("explore --motion eight --robot hal --out e.mcap", "unknown robot 'hal': expected one of asimo"),
    ("explore --motion eight --out log.mcap", "log.mcap"),
    ("explore --motion eight --out nowhere/e.mcap", "nowhere"),
    ("replay nowhere.mcap", "nowhere.mcap: no such file"),
    ("replay log.mcap --window 0", "--window"),
    ("replay log.mcap --connect nonsense --wait 0.1", "nonsense"),
    ("learn --listen nonsense --out c.npz", "nonsense"),
    ("learn --robot hal --out c.npz", "unknown robot 'hal'"),
    ("dance", "dance"),
    ("demo --out log.mcap", "log.mcap"),
]


@pytest.mark.parametrize(("line", "expected"), BAD_INPUT, ids=[line for line, _ in BAD_INPUT])
def test_bad_input_is_one_clear_line(
    files: Path, line: str, expected: str, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(files)
    before = sorted(entry.name for entry in files.iterdir())
    with pytest.raises(SystemExit) as end:
        app.main(line.split())
    printed = capfd.readouterr()
    assert end.value.code == 2
    assert printed.out == ""
    lines = printed.err.strip().splitlines()
    assert len(lines) == 1, printed.err
    assert lines[0].startswith("reenact: ")
    assert expected in lines[0]
    assert sorted(entry.name for entry in files.iterdir()) == before


def test_bad_input_is_one_clear_line_in_a_process_of_its_own(files: Path) -> None:
    assert "nowhere.mcap: no such file" in complaint(reenact("train", "nowhere.mcap", "--out", "c.npz", cwd=files))


@pytest.mark.parametrize("verb", VERBS)
def test_every_verb_shows_an_example(verb: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as end:
        app.main([verb, "--help"])
    assert end.value.code == 0
    assert re.search(r"Example(, \w[\w ]*)?: reenact", " ".join(capsys.readouterr().out.split()))


def test_help_names_every_verb(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as end:
        app.main(["--help"])
    assert end.value.code == 0
    printed = capsys.readouterr().out
    assert all(verb in printed for verb in VERBS)


def test_evaluate_gives_the_agreed_keys(
    files: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(files)
    agreed = {"mean_cm", "max_cm", "left_cm", "right_cm", "left_max_cm", "right_max_cm", "samples", "pairs"}
    linear = {"linear_cm", "linear_left_cm", "linear_right_cm"}
    teacher = {"teacher_cm", "teacher_left_cm", "teacher_right_cm"}
    for line, more in (("log.mcap", teacher | linear), ("eight", set()), ("eight --linear-from log.mcap", linear)):
        with pytest.raises(SystemExit) as end:
            app.main(["evaluate", "controller.npz", *line.split(), "--json"])
        assert end.value.code == 0
        result = json.loads(capsys.readouterr().out)
        assert result.keys() == agreed | more
        assert result["mean_cm"] == pytest.approx((result["left_cm"] + result["right_cm"]) / 2)


def test_evaluate_of_a_motion_that_was_not_recorded_says_why_it_is_compared_with_nothing(
    files: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(files)
    teacher = "not compared: the motion is no recording; --deploy lets the teacher drive the robot, too"
    linear = "not compared: the motion is no recording; --linear-from LOG.mcap fits it"
    for line, reasons in (("log.mcap", []), ("eight", [teacher, linear]), ("eight --linear-from log.mcap", [teacher])):
        with pytest.raises(SystemExit):
            app.main(["evaluate", "controller.npz", *line.split()])
        rows = dict(row.split(maxsplit=1) for row in capsys.readouterr().out.splitlines())
        assert {"teacher_cm", "linear_cm"} < rows.keys()
        assert [text for text in rows.values() if "not compared" in text] == reasons


def test_without_a_terminal_it_stays_quiet(files: Path) -> None:
    run = reenact("train", "log.mcap", "--epochs", 1, "--out", "quiet.npz", "--json", cwd=files)
    assert run.returncode == 0
    assert run.stderr == ""
    assert len(run.stdout.splitlines()) == 1
