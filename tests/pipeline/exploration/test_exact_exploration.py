"""One exploration and what is learned from it, one digest on whatever arithmetic the machine offers.

Each row stands beside a control whose bits do change: the same exploration of a robot without a resolution, or, where
the setting reaches the learner alone, a sum that the compiler may reorder.
"""

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import exact_exploration
import pytest

import pipeline
from pipeline.published import published_digests

LOCK = Path(pipeline.__file__).parent.parent / "requirements.lock"

HASWELL, SKYLAKE = {"OPENBLAS_CORETYPE": "Haswell"}, {"OPENBLAS_CORETYPE": "SkylakeX"}
OLD_BLAS, OLDER_BLAS = {"OPENBLAS_CORETYPE": "Nehalem"}, {"OPENBLAS_CORETYPE": "Prescott"}
NO_FMA = {"GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA,-FMA4"}
GENERIC = {"NUMBA_CPU_NAME": "generic"}


def explored(
    length: str, folder: Path, settings: dict[str, str], *, python: str | Path = sys.executable
) -> dict[str, Any]:
    """Explore and learn in a fresh process with these settings in its environment."""
    folder.mkdir()
    command = [str(python), exact_exploration.__file__, length, str(folder)]
    environment = os.environ | HASWELL | settings
    run = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=500, check=False)
    assert run.returncode == 0, run.stderr
    return dict(json.loads(run.stdout))


def published(names: Iterable[str]) -> dict[str, str]:
    digests = published_digests(seed=0, epochs=150, duration_s=120.0)
    assert digests is not None
    return {name: digests[name] for name in names}


def changed(found: dict[str, Any], usual: dict[str, Any]) -> set[str]:
    return {name for name, bits in found["controls"].items() if bits != usual["controls"][name]}


@pytest.fixture(scope="module")
def usual(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    return explored("short", tmp_path_factory.mktemp("usual") / "short", {})


@pytest.mark.parametrize(
    "settings",
    [pytest.param(OLD_BLAS, id="BLAS kernels of Nehalem"), pytest.param(NO_FMA, id="glibc without FMA and AVX2")],
)
def test_an_exploration_has_one_digest(usual: dict[str, Any], settings: dict[str, str], tmp_path: Path) -> None:
    found = explored("short", tmp_path / "short", settings)
    assert "unrounded" in changed(found, usual), "the setting reached nothing: this row proves nothing on this machine"
    assert found["digests"] == usual["digests"]


@pytest.fixture(scope="module")
def usual_demo(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    return explored("demo", tmp_path_factory.mktemp("usual") / "demo", {})


@pytest.fixture(scope="module")
def python_312(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Make an environment of CPython 3.12 with the locked packages."""
    pyenv = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv"))
    paths = [shutil.which("python3.12"), *sorted(map(str, pyenv.glob("versions/3.12*/bin/python")))]
    running = [path for path in paths if path and not subprocess.run([path, "-c", ""], check=False).returncode]
    if not running:
        pytest.skip("no python3.12 on the path nor of pyenv")
    folder = tmp_path_factory.mktemp("python") / "venv"
    subprocess.run([running[0], "-m", "venv", str(folder)], check=True, capture_output=True)
    python = folder / "bin" / "python"
    install = [str(python), "-m", "pip", "install", "--quiet", "--require-hashes", "-r", str(LOCK)]
    subprocess.run(install, check=True, capture_output=True, text=True)
    return python


@pytest.mark.campaign
@pytest.mark.timeout(1200)
@pytest.mark.parametrize(
    ("settings", "control"),
    [
        pytest.param(SKYLAKE, "unrounded", id="BLAS kernels of Skylake X"),
        pytest.param(OLD_BLAS, "unrounded", id="BLAS kernels of Nehalem"),
        pytest.param(OLDER_BLAS, "unrounded", id="BLAS kernels of Prescott"),
        pytest.param(NO_FMA, "unrounded", id="glibc without FMA and AVX2"),
        pytest.param(GENERIC, "compiler", id="numba for a generic CPU"),
    ],
)
def test_the_demo_is_as_published(
    usual_demo: dict[str, Any], settings: dict[str, str], control: str, tmp_path: Path
) -> None:
    found = explored("demo", tmp_path / "demo", settings)
    assert control in changed(found, usual_demo), "the setting reached nothing: this row proves nothing on this machine"
    assert found["digests"] == usual_demo["digests"] == published(found["digests"])


@pytest.mark.campaign
@pytest.mark.timeout(1200)
def test_the_demo_is_as_published_on_another_python(
    usual_demo: dict[str, Any], python_312: Path, tmp_path: Path
) -> None:
    found = explored("demo", tmp_path / "demo", OLD_BLAS, python=python_312)
    assert "unrounded" in changed(found, usual_demo)
    assert found["digests"] == published(found["digests"])
