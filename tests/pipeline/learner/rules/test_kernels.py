"""The compiled arithmetic: exp and log are right, and nothing in it comes from a mathematical library."""

import math
import os
import platform
import re
import subprocess
import sys
from decimal import Decimal, localcontext
from pathlib import Path

import numba
import numpy as np
import pytest

from pipeline.learner.rules.reservoir import kernels
from pipeline.seeding import uniforms


def exact(function, x):
    with localcontext() as context:
        context.prec = 50
        return getattr(Decimal(x), function)()


def units_off(value, truth):
    """Distance in units in the last place of the true value."""
    return float(abs(Decimal(value) - truth) / Decimal(math.ulp(float(truth))))


@pytest.mark.parametrize("limit", [1e-9, 0.35, 1.0, 30.0, 700.0])
def test_exp_is_within_two_units_in_the_last_place(limit):
    numbers = (2.0 * uniforms(0, "exp", count=2000) - 1.0) * limit
    assert max(units_off(kernels.exp(x), exact("exp", x)) for x in numbers.tolist()) <= 2.0


@pytest.mark.parametrize("k", [-1000, -1, 0, 1, 1000])
def test_exp_is_right_where_the_range_reduction_changes_over(k):
    edge = (k + 0.5) * math.log(2.0)
    for x in (math.nextafter(edge, -math.inf), edge, math.nextafter(edge, math.inf)):
        assert units_off(kernels.exp(x), exact("exp", x)) <= 2.0


def test_exp_at_and_beyond_its_ends():
    assert kernels.exp(0.0) == kernels.exp(-0.0) == 1.0
    assert kernels.exp(1e300) == kernels.exp(math.inf) == kernels.exp(709.0) < math.inf
    assert kernels.exp(-1e300) == kernels.exp(-math.inf) == kernels.exp(-708.0) > 0.0
    assert math.isnan(kernels.exp(math.nan))


@pytest.mark.parametrize("x", [1e-300, 0.01, 0.025 / 0.15, 0.9, 1.0, 1.5, 1e5, 1e300])
def test_log_undoes_exp(x):
    assert kernels.log(x) == pytest.approx(float(exact("ln", x)), rel=1e-15, abs=1e-15)


def machine_code(kernel, *arguments):
    """Assembly of a kernel for this processor, compiled anew: what comes from the cache cannot be read."""
    fresh = numba.njit(error_model="numpy")(kernel.py_func)
    fresh(*arguments)
    (assembly,) = fresh.inspect_asm().values()
    return assembly


V, M = np.zeros(8), np.zeros((8, 8))
KERNELS = {
    "sum_sources": (M, M.astype(np.uint32), V, V),
    "sum_and_gather": (M, M.astype(np.uint32), V, M, V),
    "sum_of_squares": (V,),
    "fermi": (V, V, V, V),
    "fermi_outputs": (V, V),
    "decorrelate": (M, M, V, 0.1),
    "intrinsic_plasticity": (V, V, V, V, 0.1, 0.1),
}


@pytest.mark.skipif(platform.machine() != "x86_64", reason="reads x86-64 assembly")
@pytest.mark.parametrize("name", KERNELS)
def test_kernels_fuse_nothing_and_call_no_mathematical_library(name):
    assembly = machine_code(getattr(kernels, name), *KERNELS[name])
    assert not re.findall(r"vfn?m(?:add|sub)\w*|\$(?:exp|log|pow|fma)\w*\b", assembly)


@pytest.mark.skipif(platform.machine() != "x86_64", reason="reads x86-64 assembly")
@pytest.mark.parametrize("name", ["fermi", "decorrelate", "intrinsic_plasticity"])
def test_what_runs_across_neurons_is_vectorised(name):
    assert re.search(r"v?mulpd", machine_code(getattr(kernels, name), *KERNELS[name]))


def test_the_blocks_of_memory_do_not_overlap():
    sizes = kernels.Sizes(
        inputs=2, outputs=3, reservoir=5, reservoir_slots=4, output_slots=7, feedback_slot=6, sources=12
    )
    memory = np.zeros(kernels.memory_size(sizes))
    for number, view in enumerate(kernels.views(np.array(sizes), memory), start=1):
        view += number
    counts = {number: np.size(view) for number, view in enumerate(kernels.views(np.array(sizes), memory), start=1)}
    assert counts == {number: int((memory == number).sum()) for number in counts}
    assert sum(counts.values()) == memory.size


def test_kernels_compile_where_nothing_can_be_kept(tmp_path):
    """Read-only install, no home: numba then finds no place for its cache, and refuses to compile with one."""
    (tmp_path / "file").touch()
    only = {"NUMBA_CACHE_LOCATOR_CLASSES": "UserProvidedCacheLocator", "NUMBA_CACHE_DIR": str(tmp_path / "file" / "x")}
    variables = {**os.environ, **only, "PYTHONPATH": str(Path(__file__).parents[4])}
    program = (
        "from pipeline.learner.rules.reservoir import kernels; "
        "print(kernels.exp(1.0).hex(), type(kernels.exp._cache).__name__)"
    )
    found = subprocess.run(
        [sys.executable, "-c", program], env=variables, cwd=tmp_path, capture_output=True, text=True, timeout=120
    )
    assert found.stdout.split() == [kernels.exp(1.0).hex(), "NullCache"], found.stderr
