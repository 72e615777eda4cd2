"""Without the packages of the extras: what needs one names the extra that has it, and the rest works."""

import json
import subprocess
import sys
from pathlib import Path

import pytest
from episodes import write_plain_episode

from pipeline.resources import data_path

_PROGRAM = """
import json, sys
from pipeline.extras import EXTRAS
sys.modules.update(dict.fromkeys(EXTRAS))
from pipeline.cli.app import main
for number, line in enumerate(json.loads(sys.argv[1])):
    try:
        main(line)
    except SystemExit as end:
        sys.stdout.flush()
        print(f"--- {number} {end.code}", flush=True)
        print(f"--- {number} {end.code}", file=sys.stderr, flush=True)
"""

_IMPORTING = """
import importlib, json, pkgutil, sys
from pipeline.extras import EXTRAS
sys.modules.update(dict.fromkeys(EXTRAS))
import pipeline, recorders, replay
lacking = {}
for package in (pipeline, recorders, replay):
    for module in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
        try:
            if not module.name.endswith("__main__"):
                importlib.import_module(module.name)
        except ModuleNotFoundError as error:
            lacking[module.name] = EXTRAS[error.name.partition(".")[0]]
print(json.dumps(lacking))
"""


class Run:
    """What commands printed and ended with, by their place."""

    def __init__(self, lines: list[list[str]]) -> None:
        command = [sys.executable, "-c", _PROGRAM, json.dumps(lines)]
        done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=240)
        self.out, self.status = self._parts(done.stdout)
        self.err, _ = self._parts(done.stderr)

    @staticmethod
    def _parts(text: str) -> tuple[list[str], list[int]]:
        parts, status, under_way = [], [], ""
        for line in text.splitlines(keepends=True):
            if line.startswith("--- "):
                parts.append(under_way)
                status.append(int(line.split()[2]))
                under_way = ""
            else:
                under_way += line
        return parts, status


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("core")


@pytest.fixture(scope="module")
def run(folder: Path) -> Run:
    log = write_plain_episode(folder / "log.mcap")
    case = str(data_path("golden") / "circles")
    return Run(
        [
            ["train", str(log), "--epochs", "1", "--out", str(folder / "c.npz"), "--json"],
            ["evaluate", str(folder / "c.npz"), str(log), "--json"],
            ["explore", "--motion", "circles", "--out", str(folder / "e.mcap")],
            ["view", str(log), "--save", str(folder / "v.rrd")],
            ["golden", "check", case],
            ["golden", "check", case, "--json"],
            ["golden", "check", case, "--physics"],
            ["play", "--no-browser"],
        ]
    )


def test_every_verb_and_what_runs_without_extras_is_imported_without_them() -> None:
    done = subprocess.run([sys.executable, "-c", _IMPORTING], capture_output=True, text=True, check=True, timeout=240)
    lacking = json.loads(done.stdout)
    rooms = {".".join(module.split(".")[:2]): extra for module, extra in lacking.items()}
    assert rooms == {
        "pipeline.browser": "browser",
        "pipeline.demo": "sim",
        "pipeline.deployment": "sim",
        "pipeline.drake_systems": "sim",
        "pipeline.exploration": "sim",
        "pipeline.motions": "sim",
        "pipeline.paper": "sim",
        "pipeline.robot_node": "sim",
        "pipeline.robot_setup": "sim",
        "pipeline.simulation": "sim",
        "pipeline.teacher": "sim",
        "pipeline.training": "dask",
        "pipeline.views": "view",
        "recorders.containers": "foxglove",
        "recorders.export": "parquet",
        "recorders.rerun_scene": "view",
    }
    assert [module for module in lacking if module.startswith("pipeline.training")] == ["pipeline.training.dask"]
    assert [module for module in lacking if module.startswith("pipeline.motions")] == [
        "pipeline.motions.shown_turns",
        "pipeline.motions.smoothing",
    ]


def test_a_log_trains_and_its_controller_is_evaluated(run: Run) -> None:
    assert run.status[:2] == [0, 0], run.err[:2]
    assert json.loads(run.out[0])["steps"] > 0
    assert json.loads(run.out[1])["mean_cm"] > 0.0


@pytest.mark.parametrize(
    ("place", "package", "extra"), [(2, "pydrake", "sim"), (3, "rerun", "view"), (7, "viser", "browser")]
)
def test_what_needs_a_missing_package_names_its_extra_in_one_line(
    run: Run, place: int, package: str, extra: str
) -> None:
    assert run.status[place] == 2
    assert run.err[place].splitlines() == [
        f"reenact: this needs the package {package}, which is not installed; "
        f"install reenact-robot with its extra {extra}, as `pip install '.[{extra}]'` does in its source folder"
    ]


def test_physics_that_cannot_be_checked_is_counted_and_told(run: Run) -> None:
    assert run.status[4:6] == [0, 0]
    assert run.out[4] == "passed  circles  physics not checked: install sim\n"
    found = json.loads(run.out[5])
    assert found["physics_not_checked"] == 1
    assert found["failed"] == 0
    assert found["cases"][0]["physics"] == "not checked: install sim"


def test_physics_that_is_asked_for_must_be_checked(run: Run) -> None:
    assert run.status[6] == 2
    assert "install reenact-robot with its extra sim, as `pip install '.[sim]'` does" in run.err[6]


def test_nothing_is_written_by_what_could_not_run(run: Run, folder: Path) -> None:
    assert run.status[2:4] == [2, 2]
    assert {path.name for path in folder.iterdir()} == {"log.mcap", "c.npz"}
