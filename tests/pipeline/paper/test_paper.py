"""The paper, rerun by its verb in a process: the short run through everything, and the full one as a campaign."""

import html
import json
import re
import shlex
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import pytest
from clusters import local_cluster
from processes import reenact

from pipeline.cli import app
from pipeline.learner.controller import Controller
from pipeline.learner.rules.reservoir.config import LearnerConfig
from pipeline.motions.names import PATTERNS
from pipeline.paper.run import PaperConfig, drawings, run_paper
from pipeline.training.trainer import train
from recorders.errors import ConfigError, WireError
from recorders.reading.reader import LogReader
from recorders.wire.loopback import free_endpoint
from replay.sources.schedule import Schedule

QUICK = PaperConfig.quick()
RUN_TIMEOUT_S = 280


@pytest.fixture(scope="module")
def quick(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """The folder and the printed result of a short run."""
    folder = tmp_path_factory.mktemp("paper")
    run = reenact("paper", "--quick", "--json", "--out", "out", cwd=folder, timeout_s=RUN_TIMEOUT_S)
    assert run.returncode == 0, run.stderr
    assert run.stderr == ""
    return folder / "out", json.loads(run.stdout)


def assert_keys(result: dict[str, Any]) -> None:
    assert list(result) == [
        "pattern1",
        "pattern2",
        "demonstrations",
        "deployed",
        "seconds_explore_and_learn",
        "comparison",
    ]
    assert list(result["comparison"]) == [
        "seeds",
        "explorations",
        "refused",
        "not_compared",
        "rules",
        "error_parts",
        "goal_babbling",
        "teachers",
        "learning_step_us",
        "command_us",
        "papers_step_us",
        "seconds_explore_and_learn",
    ]
    columns = [*PATTERNS, *(f"{name}_{hand}" for name in drawings() for hand in ("left", "right"))]
    for name in ("taught_120s", "taught_30s", "self_taught_120s", "self_taught_30s"):
        assert list(result["comparison"]["explorations"][name]) == columns
    for rule in result["comparison"]["rules"].values():
        assert list(rule) == ["errors", "tick_us", "command_us"]
        assert list(rule["errors"]) == columns
    assert list(result["comparison"]["goal_babbling"]) == ["self_taught_120s", "self_taught_30s"]
    assert [one["teacher"] for one in result["comparison"]["teachers"]] == ["rates", "qp"]
    assert list(result["pattern1"]) == ["train_cm_mean", "train_cm_std", "on_pattern2_cm_mean"]
    assert list(result["pattern2"]) == ["train_cm_mean", "train_cm_std", "on_pattern1_cm_mean"]
    assert list(result["deployed"]) == ["learned_cm", "teacher_cm"]
    for demonstration in result["demonstrations"]:
        assert list(demonstration) == ["name", "network", "left_cm", "right_cm"]
    pairs = [(one["name"], one["network"]) for one in result["demonstrations"]]
    assert pairs == [(name, network) for network in ("pattern1", "pattern2") for name in drawings()]


def test_the_result_has_the_agreed_keys(quick: tuple[Path, dict[str, Any]]) -> None:
    folder, result = quick
    assert_keys(result)
    assert json.loads((folder / "summary.json").read_text()) == result


def test_every_log_and_every_network_is_left_to_look_at(quick: tuple[Path, dict[str, Any]]) -> None:
    folder, _ = quick
    for name in ("circles", "eight", *drawings()):
        assert LogReader(folder / f"{name}.mcap").counts["/sample/joint_states"] > 60
    saved = {path.name for path in (folder / "controllers").iterdir()}
    assert saved == {f"{pattern}-{seed}.npz" for pattern in ("circles", "eight") for seed in QUICK.seeds}
    explored = {path.name for path in (folder / "explorations").iterdir()}
    assert explored == {f"{one.name}-{QUICK.seed}.mcap" for one in QUICK.comparison.explorations}
    assert not list(folder.rglob("*.part"))


@pytest.mark.parametrize(("pattern", "epochs"), [("circles", QUICK.epochs[0]), ("eight", QUICK.epochs[1])])
def test_the_command_of_the_report_gives_the_same_network(
    quick: tuple[Path, dict[str, Any]], pattern: str, epochs: int
) -> None:
    folder, _ = quick
    log, seed = folder / f"{pattern}.mcap", QUICK.seeds[-1]
    trainer = train([log], schedule=Schedule(epochs=epochs), config=LearnerConfig(seed=seed))
    saved = Controller.load(folder / "controllers" / f"{pattern}-{seed}.npz")
    assert saved.digest == trainer.result()["digest"]
    assert saved.provenance["errors_cm"] == trainer.errors_cm


def rows_of(page: Path) -> list[list[str]]:
    """The cells of the page's table of numbers, commands a line each."""
    text = page.read_text(encoding="utf-8").replace("</code><code>", "\n")
    table = re.sub("</?code>", "", text.partition("<h2>Every number</h2>")[2].partition("</table>")[0])
    rows = re.findall(r"<tr>(<td.*?)</tr>", table, flags=re.DOTALL)
    return [[html.unescape(cell) for cell in re.findall(r"<td[^>]*>(.*?)</td>", row, flags=re.DOTALL)] for row in rows]


class _Runner:
    """Runs commands of a page in this process, each once, and keeps what it printed."""

    def __init__(self, capsys: pytest.CaptureFixture[str]) -> None:
        self._capsys = capsys
        self._printed: dict[str, dict[str, Any]] = {}

    def run(self, command: str) -> dict[str, Any]:
        if command not in self._printed:
            name, *arguments = shlex.split(command)
            assert name == "reenact"
            with pytest.raises(SystemExit) as end:
                app.main([*arguments, "--json"])
            assert end.value.code == 0, command
            self._printed[command] = json.loads(self._capsys.readouterr().out)
        return self._printed[command]


def shown(numbers: list[float]) -> str:
    return f"{np.mean(numbers):.2f} ± {np.std(numbers, ddof=1):.2f}" if len(numbers) > 1 else f"{numbers[0]:.2f}"


def test_every_number_of_the_page_comes_out_of_its_commands(
    quick: tuple[Path, dict[str, Any]], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, _ = quick
    monkeypatch.chdir(folder)
    before = {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}
    runner = _Runner(capsys)
    rows = rows_of(folder / "report.html")
    assert len(rows) == 4 + 6 * len(drawings()) + 2
    for what, ours, _, teacher, linear, seeds, commands, name in rows:
        if name == "–":  # a time: the whole rerun takes it
            continue
        first, _, last = seeds.partition("–")
        printed = []
        for seed in range(int(first), int(last or first) + 1):
            lines = commands.replace("SEED", str(seed)).splitlines()
            printed.append({key: value for line in lines for key, value in runner.run(line).items()})
        assert ours == shown([one[name] for one in printed]), what
        part = "" if name in ("mean_cm", "train_cm", "learned_cm") else name.removesuffix("cm")
        for cell, whose in ((teacher, "teacher"), (linear, "linear")):
            assert cell in ("–", f"{printed[0][f'{whose}_{part}cm']:.2f}" if cell != "–" else ""), what
    assert all((folder / name).read_bytes() == content for name, content in before.items())


def test_without_its_cluster_it_ends_at_once_with_one_line(tmp_path: Path) -> None:
    address = free_endpoint().replace("tcp/", "tcp://")
    run = reenact("paper", "--quick", "--scheduler", address, cwd=tmp_path)
    assert run.returncode == 2
    assert run.stderr.startswith(f"reenact: no Dask scheduler answers at {address}")
    assert not list(tmp_path.rglob("*.mcap"))


def test_a_run_without_epochs_is_refused() -> None:
    with pytest.raises(ConfigError, match="expected a seed of at least 0, one initialisation and one epoch"):
        PaperConfig(epochs=(0, 1))


def test_an_earlier_result_does_not_stand_when_a_run_fails(tmp_path: Path) -> None:
    def fail() -> NoReturn:
        raise WireError("no cluster")

    (tmp_path / "controllers").mkdir()
    stale = ("summary.json", "report.html", "figure4a.png", "controllers/circles-9.npz", "eight.mcap.part")
    for name in (*stale, "holiday.png"):
        (tmp_path / name).write_text("old")
    with pytest.raises(WireError):
        run_paper(tmp_path, config=QUICK, executors=fail)
    assert [path.name for path in tmp_path.rglob("*.*")] == ["holiday.png"]


def test_a_file_is_no_folder_to_write_to(tmp_path: Path) -> None:
    (tmp_path / "out").write_text("")
    with pytest.raises(ConfigError, match="out: expected a folder to write to: "):
        run_paper(tmp_path / "out", config=QUICK)


@pytest.mark.campaign
def test_on_a_cluster_it_comes_to_the_same(quick: tuple[Path, dict[str, Any]], tmp_path: Path) -> None:
    folder, _ = quick
    with local_cluster() as address:
        command = ("paper", "--quick", "--json", "--out", "out", "--scheduler", address)
        run = reenact(*command, cwd=tmp_path, timeout_s=RUN_TIMEOUT_S)
    assert run.returncode == 0, run.stderr
    for saved in sorted((folder / "controllers").iterdir()):
        there = Controller.load(tmp_path / "out" / "controllers" / saved.name)
        assert there.digest == Controller.load(saved).digest


@pytest.mark.campaign
@pytest.mark.timeout(1800)
def test_the_whole_of_it_keeps_every_bound(tmp_path: Path) -> None:
    run = reenact("paper", "--json", "--out", "out", cwd=tmp_path, timeout_s=1700)
    assert run.returncode == 0, run.stderr
    result = json.loads(run.stdout)
    assert_keys(result)
    assert result["pattern1"]["train_cm_mean"] <= 1.40
    assert result["pattern2"]["train_cm_mean"] <= 1.50
    assert result["pattern1"]["on_pattern2_cm_mean"] <= 1.30
    assert result["pattern2"]["on_pattern1_cm_mean"] >= 2.5 * result["pattern2"]["train_cm_mean"]
    assert all(one["left_cm"] < 2.0 for one in result["demonstrations"] if one["network"] == "pattern1")
    *_, commands, name = rows_of(tmp_path / "out" / "report.html")[-1]
    assert name == "–"
    for command in (*commands.splitlines(), "reenact diff again-circles.mcap circles.mcap"):
        again = reenact(*shlex.split(command)[1:], cwd=tmp_path / "out", timeout_s=120)
        assert again.returncode == 0, again.stderr
