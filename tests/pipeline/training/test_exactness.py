"""One training, one digest on whatever arithmetic the machine offers; each row beside a control whose bits change."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import exactness
import pytest
from episodes import write_plain_episode

ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
TWO_THREADS = dict.fromkeys(ONE_THREAD, "2")

NO_SIMD = {"NPY_DISABLE_CPU_FEATURES": "X86_V3 X86_V4"}
GENERIC = {"NUMBA_CPU_NAME": "generic"}
OLD_BLAS = {"OPENBLAS_CORETYPE": "Nehalem"}
OLDER_BLAS = {"OPENBLAS_CORETYPE": "Prescott"}
AVX_BLAS = {"OPENBLAS_CORETYPE": "Sandybridge"}
NO_FMA = {"GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA,-FMA4"}

ROWS = [
    pytest.param(NO_SIMD, {"numpy"}, id="numpy without SIMD"),
    pytest.param(GENERIC, {"compiler"}, id="numba for a generic CPU"),
    pytest.param(OLD_BLAS, {"blas", "dot"}, id="BLAS kernels of Nehalem"),
    pytest.param(OLDER_BLAS, {"blas", "dot"}, marks=pytest.mark.campaign, id="BLAS kernels of Prescott"),
    pytest.param(AVX_BLAS, {"blas", "dot"}, marks=pytest.mark.campaign, id="BLAS kernels of Sandy Bridge"),
    pytest.param(NO_FMA, {"libm"}, id="glibc without FMA and AVX2"),
    pytest.param(ONE_THREAD, {"dot"}, id="one thread"),
    pytest.param(
        NO_SIMD | GENERIC | OLD_BLAS | NO_FMA | ONE_THREAD,
        {"numpy", "compiler", "blas", "dot", "libm"},
        id="all at once",
    ),
]


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_plain_episode(tmp_path_factory.mktemp("exactness") / "plain.mcap", measured=True)


@pytest.fixture(scope="module")
def usual(log: Path) -> dict[str, Any]:
    return trained(log, TWO_THREADS)


def trained(log: Path, settings: dict[str, str]) -> dict[str, Any]:
    """Train in a fresh process with these settings in its environment."""
    program = [sys.executable, exactness.__file__, str(log)]
    environment = os.environ | TWO_THREADS | settings
    run = subprocess.run(program, env=environment, capture_output=True, text=True, timeout=120, check=False)
    assert run.returncode == 0, run.stderr
    return dict(json.loads(run.stdout))


@pytest.mark.parametrize(("settings", "changed"), ROWS)
def test_a_training_has_one_digest(
    log: Path, usual: dict[str, Any], settings: dict[str, str], changed: set[str]
) -> None:
    found = trained(log, settings)
    differing = {name for name, bits in found["controls"].items() if bits != usual["controls"][name]}
    assert changed <= differing, "the setting reached nothing: this row proves nothing on this machine"
    assert found["digests"] == usual["digests"]


def test_controls_are_the_same_in_a_second_process(log: Path, usual: dict[str, Any]) -> None:
    assert trained(log, {}) == usual
