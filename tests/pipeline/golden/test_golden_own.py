"""What a team uses today is compared with what its golden cases were made with, if it is named."""

import shutil
from pathlib import Path

import pytest
from episodes import write_episode

from pipeline.cli import app
from pipeline.golden.own_settings import Own, read_settings
from pipeline.golden.runner import GoldenRunner
from pipeline.resources import data_path
from recorders.errors import ConfigError
from replay.golden.add import add_case
from replay.golden.case import load_case
from replay.golden.check import check_case
from replay.golden.recipe import CaseSpec
from replay.sources.schedule import Schedule

SETTINGS = "reservoir = 20\nseed = 4\n"


@pytest.fixture(scope="module")
def work(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a case, and the learner's settings and the robot that it was made with."""
    work = tmp_path_factory.mktemp("own")
    log = write_episode(work / "log.mcap", samples=4)
    (work / "learner.toml").write_text(SETTINGS)
    shutil.copytree(data_path("robots", "asimo"), work / "robot")
    recipe = CaseSpec((log,), read_settings(work / "learner.toml"), Schedule(epochs=1))
    add_case(work / "golden/a", recipe, GoldenRunner())
    return work


def check(work: Path, capsys: pytest.CaptureFixture[str], *options: str) -> tuple[int, str]:
    with pytest.raises(SystemExit) as end:
        app.main(["golden", "check", str(work / "golden"), *options])
    printed = capsys.readouterr()
    return int(end.value.code or 0), (printed.out + printed.err).strip()


def test_what_is_as_it_was_passes_whatever_its_layout(work: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (work / "same.toml").write_text("# the same\nseed = 4\n\nreservoir = 20\nbpdc_epsilon = 0.002\n")
    shutil.copytree(work / "robot", work / "commented")
    for name, comment in (("robot.toml", "# ours\n{}"), ("robot.urdf", "{}<!-- ours -->\n")):
        text = (work / "robot" / name).read_text()
        (work / "commented" / name).write_text(comment.format(text))
    options = ("--config", str(work / "same.toml"), "--robot", str(work / "commented"))
    assert check(work, capsys, *options) == (0, "passed  a")


@pytest.mark.parametrize(
    ("name", "old", "new", "found"),
    [
        ("learner.toml", "reservoir = 20", "reservoir = 21", "learner setting reservoir: expected 20, found 21"),
        ("learner.toml", "seed = 4", "", "learner setting seed: expected 4, found 0"),
        ("robot/robot.toml", "centre = [0.32", "centre = [0.33", "robot's hand left, centre: expected (0.32, "),
        ("robot/robot.toml", "box = [0.069", "box = [0.07", "robot's hand left, box: expected (0.069, "),
        ("robot/robot.toml", 'name = "asimo"', 'name = "ours"', "robot's name: expected 'asimo', found 'ours'"),
        ("robot/robot.urdf", "0 0 -0.21", "0 0 -0.22", "robot.urdf, joint left_elbow: expected '<origin "),
    ],
)
def test_what_is_no_longer_so_is_a_finding(
    work: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str, old: str, new: str, found: str
) -> None:
    ours = tmp_path / "ours"
    shutil.copytree(work, ours)
    text = (ours / name).read_text()
    assert old in text
    (ours / name).write_text(text.replace(old, new, 1))
    assert check(ours, capsys)[0] == 0  # the case is complete in itself
    code, line = check(ours, capsys, "--config", str(ours / "learner.toml"), "--robot", str(ours / "robot"))
    assert code == 1
    assert line.startswith(f"failed  a  case: {found}"), line
    assert line.endswith("(what is used today is not what the case was made with)")


def test_the_shipped_cases_are_of_the_shipped_robot() -> None:
    own = Own(robot="asimo")
    for name in ("circles", "live_session"):
        assert own.difference(load_case(data_path("golden", name)).recipe) is None
    assert check_case(data_path("golden", "resumed"), GoldenRunner(), changed=own.difference).finding is None


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("inputs = 6", "expected no setting inputs, which follows from the robot's hands; take it out"),
        ("outputs = 21", "expected no setting outputs, which follows from the robot's joints; take it out"),
        ("epochs = 3", "expected no setting epochs, which follows from --epochs, or the session; take it out"),
        ("colour = 1", "unknown learner setting colour"),
        ("[learner]\nseed = 1", "unknown learner setting learner"),
        ("seed = 1.5", "expected learner setting seed to be a whole number"),
        ("seed = ", "learner.toml: "),
    ],
)
@pytest.mark.parametrize("verb", ["check", "add"])
def test_no_setting_is_passed_over(
    work: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str, why: str, verb: str
) -> None:
    config = tmp_path / "learner.toml"
    config.write_text(text + "\n")
    new = ("add", str(work / "log.mcap"), "--name", "new", "--cases", str(tmp_path))
    arguments = new if verb == "add" else ("check", str(work / "golden"))
    with pytest.raises(SystemExit) as end:
        app.main(["golden", *arguments, "--config", str(config)])
    (line,) = capsys.readouterr().err.splitlines()
    assert end.value.code == 2
    assert f"{config}: " in line
    assert why in line
    with pytest.raises(ConfigError):
        read_settings(config)
