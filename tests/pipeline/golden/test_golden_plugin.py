"""`pytest --golden DIR` in somebody else's project: each case is a test."""

import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
from episodes import write_episode

from pipeline.golden.runner import GoldenRunner
from pipeline.learner.rules.reservoir.config import LearnerConfig
from replay.golden.add import add_case
from replay.golden.recipe import CaseSpec
from replay.sources.schedule import Schedule

ROOT = Path(__file__).parents[3]


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    tmp_path = tmp_path_factory.mktemp("project")
    log = write_episode(tmp_path / "log.mcap", samples=6)
    recipe = CaseSpec((log,), LearnerConfig(reservoir=20, seed=1).to_dict(), Schedule(epochs=1))
    one = add_case(tmp_path / "golden" / "one", recipe, GoldenRunner()).folder
    shutil.copytree(one, one.with_name("two"))
    (tmp_path / "tests").mkdir()
    # What is imported shows that the plugin alone costs nothing.
    heavy = "numba", "pinocchio", "pydrake", "zenoh", "numpy", "replay.golden.check"
    test = f"import sys\n\ndef test_light():\n    assert not set({heavy!r}) & set(sys.modules)\n"
    (tmp_path / "tests" / "test_own.py").write_text(test)
    (tmp_path / "pytest.ini").write_text("[pytest]\ntestpaths = tests\n")
    return tmp_path


def run_pytest(project: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    places = os.pathsep.join([str(ROOT), str(ROOT / "pipeline" / "pytest_entry")])
    alone = {"PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1", "PYTHONPATH": places, "PYTHONDONTWRITEBYTECODE": "1"}
    return pytest_in(project, alone, "-p", "reenact_pytest", "-v", *arguments)


def pytest_in(project: Path, environment: dict[str, str], *arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "pytest", *arguments]
    return subprocess.run(
        command, cwd=project, env=os.environ | environment, capture_output=True, text=True, timeout=120, check=False
    )


def test_cases_are_collected_beside_the_projects_own_tests(project: Path) -> None:
    run = run_pytest(project, "--golden", "golden")
    assert run.returncode == 0, run.stdout + run.stderr
    assert "tests/test_own.py::test_light PASSED" in run.stdout
    for name in ("one", "two"):
        assert f"golden/{name}::golden PASSED" in run.stdout


@pytest.mark.parametrize("arguments", [(), (".",)], ids=["alone", "beside the folder around it"])
def test_no_case_is_passed_over(project: Path, tmp_path: Path, arguments: tuple[str, ...]) -> None:
    project = shutil.copytree(project, tmp_path / "project")
    golden = project / "golden"
    for name in ("build", "dist", "venv", "node_modules", "a.egg"):  # pytest does not look into such folders
        shutil.copytree(golden / "one", golden / "deeper" / name)
    (golden / "one").rename(golden / "build")
    run = run_pytest(project, "--golden", "golden", "--collect-only", "-qq", *arguments)
    assert run.returncode == 0, run.stdout + run.stderr
    found = [line for line in run.stdout.splitlines() if line.startswith("golden/")]
    deeper = [f"golden/deeper/{name}::golden" for name in ("a.egg", "build", "dist", "node_modules", "venv")]
    assert sorted(found) == sorted(["golden/build::golden", "golden/two::golden", *deeper])


def test_a_case_that_pytest_passes_over_all_the_same_is_an_error(project: Path, tmp_path: Path) -> None:
    project = shutil.copytree(project, tmp_path / "project")
    (project / "build").mkdir()
    (project / "golden").rename(project / "build" / "golden")
    run = run_pytest(project, ".", "--golden", "build/golden")
    assert run.returncode == 4, run.stdout + run.stderr
    assert "build/golden/one to be collected, found it ignored; give its folder alone" in run.stderr


def test_a_folder_without_cases(project: Path, tmp_path: Path) -> None:
    run = run_pytest(project, "--golden", str(tmp_path))
    assert run.returncode == 4, run.stdout + run.stderr
    assert "expected golden cases, folders with a case.json" in run.stderr


def test_a_failure_is_the_first_divergence(project: Path, tmp_path: Path) -> None:
    project = shutil.copytree(project, tmp_path / "project")
    log = project / "golden" / "two" / "log.mcap"
    log.write_bytes(log.read_bytes()[:-500])
    run = run_pytest(project, "--golden", "golden")
    assert run.returncode == 1, run.stdout + run.stderr
    assert "1 failed, 2 passed" in run.stdout
    assert "golden case two: log: log log.mcap: file: expected an undamaged log" in run.stdout
    assert "Traceback" not in run.stdout


def test_one_case_can_be_chosen(project: Path) -> None:
    run = run_pytest(project, "--golden", "golden", "-k", "two", "--collect-only")
    assert "<GoldenFolder two>" in run.stdout
    assert "<GoldenFolder one>" not in run.stdout


def test_without_the_option_nothing_is_collected(project: Path) -> None:
    run = run_pytest(project)
    assert "1 passed" in run.stdout
    assert "golden" not in run.stdout.split("collected", 1)[1]


def test_a_folder_that_is_none(project: Path) -> None:
    run = run_pytest(project, "--golden", "nowhere")
    assert run.returncode == 4
    assert "--golden: nowhere: expected golden cases" in run.stderr


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel, unpacked where nothing of the checkout is."""
    folder = tmp_path_factory.mktemp("wheel")
    build = f"from hatchling.build import build_wheel; build_wheel({str(folder)!r})"
    subprocess.run([sys.executable, "-c", build], cwd=ROOT, check=True, capture_output=True, text=True)
    (wheel,) = folder.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(folder / "installed")
    return folder / "installed"


@pytest.fixture
def namesake(tmp_path: Path, project: Path) -> Path:
    """A project that has a package of the name of one of ours, which its own test imports."""
    shutil.copytree(project / "golden", tmp_path / "golden")
    imports = "import sys\n\nimport pipeline\n\n\n"
    test = f"{imports}def test_own():\n    assert pipeline.OWN and 'recorders' not in sys.modules\n"
    (tmp_path / "test_own.py").write_text(test)
    (tmp_path / "pipeline").mkdir()
    (tmp_path / "pipeline" / "__init__.py").write_text("OWN = True\n")
    (tmp_path / "pytest.ini").touch()
    return tmp_path


def loaded_by_itself(installed: Path) -> dict[str, str]:
    return {"PYTHONPATH": str(installed), "PYTHONDONTWRITEBYTECODE": "1"}


def test_a_project_with_a_package_of_the_same_name_is_tested_as_ever(namesake: Path, installed: Path) -> None:
    run = pytest_in(namesake, loaded_by_itself(installed), "-v")
    assert run.returncode == 0, run.stdout + run.stderr
    assert "test_own.py::test_own PASSED" in run.stdout
    assert "--golden=DIR" in pytest_in(namesake, loaded_by_itself(installed), "--help").stdout


@pytest.mark.parametrize("name", ["pipeline", "replay"])
def test_where_names_clash_the_cases_are_refused_in_one_line(namesake: Path, installed: Path, name: str) -> None:
    (namesake / "pipeline").rename(namesake / name)
    run = pytest_in(namesake, loaded_by_itself(installed), "--golden", "golden")
    assert run.returncode == 4, run.stdout + run.stderr
    expected = f"ERROR: --golden: expected the package {name} of reenact, found {namesake / name / '__init__.py'}"
    assert [line for line in run.stderr.splitlines() if line] == [
        f"{expected} of the same name in this project; check the cases with `reenact golden check DIR`"
    ]


def test_cases_of_another_project_are_collected_whatever_packages_it_has(
    namesake: Path, installed: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    here = tmp_path_factory.mktemp("elsewhere")
    golden = str(namesake / "golden")
    run = pytest_in(here, loaded_by_itself(installed), "--golden", golden, "--collect-only", "-q")
    assert run.returncode == 0, run.stdout + run.stderr
    assert "one::golden" in run.stdout
