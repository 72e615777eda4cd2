"""`golden add` and `golden check`, as a user runs them."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import pytest
from episodes import write_episode
from here import reenact_here
from processes import complaint

from pipeline.cli import app
from recorders.messages.message_types import JointState, Message

SETTINGS = "reservoir = 30\nseed = 4\n"


@pytest.fixture(scope="module")
def work(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("golden")
    write_episode(folder / "log.mcap", samples=8)
    (folder / "learner.toml").write_text(SETTINGS)
    made = reenact_here("golden", "add", "log.mcap", "--config", "learner.toml", "--name", "a", "--json", cwd=folder)
    assert made.returncode == 0, made.stderr
    assert json.loads(made.stdout)["bytes"] < 300_000
    return folder


def test_a_case_that_holds(work: Path) -> None:
    run = reenact_here("golden", "check", "golden", "--json", cwd=work)
    assert run.returncode == 0, run.stderr
    case = {"name": "a", "status": "passed", "tier": None, "first_divergence": None}
    assert json.loads(run.stdout) == {"checked": 1, "failed": 0, "cases": [case]}


def test_a_case_that_does_not_hold(work: Path, tmp_path: Path) -> None:
    shutil.copytree(work / "golden", tmp_path / "golden")
    shutil.copytree(work / "golden" / "a", tmp_path / "golden" / "b")
    log = tmp_path / "golden" / "b" / "log.mcap"
    log.write_bytes(log.read_bytes()[:-500])
    run = reenact_here("golden", "check", "golden", cwd=tmp_path)
    assert run.returncode == 1, run.stderr
    passed, failed = run.stdout.splitlines()
    assert passed == "passed  a"
    assert failed.startswith("failed  b  log: log log.mcap: file: expected an undamaged log, found ")


def test_a_log_that_makes_no_case_is_named_as_it_was_given(
    work: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def late(tick: int, topic: str, message: Message) -> list[tuple[str, Message]]:
        return [
            (topic, replace(message, stamp_ns=message.stamp_ns + 7) if isinstance(message, JointState) else message)
        ]

    monkeypatch.chdir(work)
    write_episode(work / "late.mcap", samples=3, change=late)
    line = run_verb(capsys, "add", "late.mcap", "--config", "learner.toml", "--name", "late")[1]
    assert line.startswith("reenact: late.mcap: the tick at 0 ns lacks /sample/joint_states"), line
    assert not list((work / "golden").glob("*late*"))


def test_a_case_that_cannot_be_read_fails_alone(work: Path, tmp_path: Path) -> None:
    shutil.copytree(work / "golden", tmp_path / "golden")
    shutil.copytree(work / "golden" / "a", tmp_path / "golden" / "b")
    (tmp_path / "golden" / "a" / "case.json").write_text("{")
    run = reenact_here("golden", "check", "golden", "--json", cwd=tmp_path)
    assert run.returncode == 1, run.stderr
    found = json.loads(run.stdout)
    assert [(case["name"], case["status"], case["tier"]) for case in found["cases"]] == [
        ("a", "failed", "case"),
        ("b", "passed", None),
    ]
    assert "expected JSON" in found["cases"][0]["first_divergence"]["text"]


def test_a_change_needs_its_reason(
    work: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(work, tmp_path / "work")
    work = tmp_path / "work"
    (work / "learner.toml").write_text("reservoir = 30\nseed = 5\n")
    monkeypatch.chdir(work)
    again = ("add", "log.mcap", "--config", "learner.toml", "--name", "a")
    before = (work / "golden" / "a" / "case.json").read_text()
    assert "--reason" in run_verb(capsys, *again)[1]
    assert (work / "golden" / "a" / "case.json").read_text() == before
    assert run_verb(capsys, *again, "--reason", "another seed")[0] == 0
    history = json.loads((work / "golden" / "a" / "case.json").read_text())["history"]
    assert [entry["reason"] for entry in history] == ["the first of this name", "another seed"]
    assert history[0]["digest"] != history[1]["digest"]
    assert [path.name for path in (work / "golden").iterdir()] == ["a"]


def run_verb(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str]:
    with pytest.raises(SystemExit) as ended:
        app.main(["golden", *arguments])
    assert isinstance(ended.value.code, int)
    return ended.value.code, capsys.readouterr().err


def test_a_case_made_anew_keeps_what_is_not_said(
    work: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("log.mcap", "learner.toml"):
        shutil.copy(work / name, tmp_path)
    monkeypatch.chdir(tmp_path)
    options = ("--epochs", "1", "--resume-after", "12")
    assert run_verb(capsys, "add", "log.mcap", "--config", "learner.toml", "--name", "b", *options)[0] == 0
    before = json.loads(Path("golden/b/case.json").read_text())
    assert run_verb(capsys, "add", "--name", "b", "--reason", "nothing but a test")[0] == 0
    after = json.loads(Path("golden/b/case.json").read_text())
    assert after.pop("history") == [
        *before.pop("history"),
        {"reason": "nothing but a test", "digest": before["expected"]["digest"]},
    ]
    assert after == before
    assert run_verb(capsys, "add", "--name", "b", "--reason", "more", "--epochs", "2", "--resume-after", "9")[0] == 0
    changed = json.loads(Path("golden/b/case.json").read_text())["history"][-1]["changed"]
    assert [change.split(":")[0] for change in changed] == ["schedule", "resume_after"]
    assert changed[1] == "resume_after: 12 -> 9"
    assert "--reason" in run_verb(capsys, "add", "--name", "b", "--reason", "  ")[1]
    assert "expected logs and --config for a new case" in run_verb(capsys, "add", "--name", "c")[1]
    unread = "there-is-none.mcap"  # what is missing is named before logs are read
    assert "for a new case, found no --config" in run_verb(capsys, "add", unread, "--name", "c")[1]


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (("--epochs", "7"), "at most 6 epochs"),
        (("--as-recorded",), "phase markers"),
        (("--physics",), "expected a log of explore"),
        (("--resume-after", "127"), "expected to resume after a tick of the run, found 127 of 126"),
        (("--config", "none.toml"), "none.toml: no such file"),
        (("--config", "log.mcap"), "log.mcap: expected TOML"),
        (("--config", "unknown.toml"), "unknown learner setting neurons"),
        (("--name", "../b"), "plain file name"),
        (("--epochs", "6"), "expected at most 300000 bytes"),
    ],
)
def test_what_makes_no_case(
    work: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    options: tuple[str, ...],
    says: str,
) -> None:
    for name in ("log.mcap", "learner.toml"):
        shutil.copy(work / name, tmp_path)
    (tmp_path / "unknown.toml").write_text("neurons = 3\n")
    if says.endswith("bytes"):
        (tmp_path / "learner.toml").write_text("reservoir = 500\n")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as ended:
        app.main(["golden", "add", "log.mcap", "--config", "learner.toml", "--name", "b", *options])
    assert ended.value.code == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert says in line
    assert not list(tmp_path.glob("**/case.json"))


def test_no_cases_are_bad_usage(tmp_path: Path) -> None:
    assert "expected golden cases" in complaint(reenact_here("golden", "check", tmp_path, cwd=tmp_path))
