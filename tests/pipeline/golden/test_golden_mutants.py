"""A golden check catches what goes wrong in the kernels of `forward-inverse`, or the change changes nothing."""

import ast
import inspect
import random
import warnings
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from mutation import Mutant, find_mutants, module_of_tree, mutated_module

from pipeline.golden.runner import GoldenRunner
from pipeline.learner.rules.forward_inverse import kernels
from pipeline.learner.rules.forward_inverse import learner as learners
from pipeline.learner.rules.forward_inverse.config import ForwardInverseConfig
from pipeline.learner.rules.forward_inverse.learner import ForwardInverseLearner
from pipeline.learner.state import state_digest
from pipeline.resources import data_path
from replay.golden.check import check_case
from replay.golden.finding import Finding

CASES = [Path(data_path("golden", name)) for name in ("forward_inverse_held", "forward_inverse")]
SOURCE = inspect.getsource(kernels)


def draw_mutants(count: int, *, seed: int) -> list[Mutant]:
    """Changes of what is computed in compiled functions, but for deviations, which enter neither outputs nor state."""
    compiled = {
        node.name for node in ast.parse(SOURCE).body if isinstance(node, ast.FunctionDef) and node.decorator_list
    }
    functions = compiled - {"expect", "fit_errors"}
    return random.Random(seed).sample(
        [mutant for mutant in find_mutants(SOURCE) if mutant.function in functions], count
    )


def plain_kernels(mutant: Mutant | None = None) -> ModuleType:
    """The kernels, not compiled, with a change or as they are."""
    if mutant is not None:
        return mutated_module(SOURCE, mutant, name=kernels.__name__, prepare=without_decorators)
    tree = ast.parse(SOURCE)
    without_decorators(tree)
    return module_of_tree(tree, name=kernels.__name__)


def without_decorators(tree: ast.Module) -> None:
    for function in tree.body:
        if isinstance(function, ast.FunctionDef):
            function.decorator_list = []


MUTANTS = draw_mutants(60, seed=13)


def results() -> tuple[str, ...]:
    """What a learner comes to on other data than the case's: far targets, and joints at their limits."""
    generator, found = np.random.default_rng(0), []
    for forgetting, residual in ((1.0, 0), (0.9, 2)):
        degrees = {"degree": 2, "residual_degree": residual}
        config = ForwardInverseConfig(inputs=3, outputs=7, forgetting=forgetting, **degrees)
        learner = ForwardInverseLearner(config, input_centre=np.zeros(3), output_centre=np.zeros(7))
        u, q = generator.uniform(-0.5, 0.5, (40, 3)), generator.uniform(-3.0, 3.0, (40, 4))
        outputs = learner.step(u, np.concatenate([u, q], axis=1), learning=True)
        parts = outputs, learner.predict(4.0 * u)
        found += [
            state_digest(dict(zip("ab", parts, strict=True))),
            state_digest(learner.state()),
        ]
    return tuple(found)


def first_finding() -> Finding | None:
    """What the first of the cases that does not hold names."""
    findings = (check_case(case, GoldenRunner()).finding for case in CASES)
    return next((finding for finding in findings if finding is not None), None)


@pytest.fixture(scope="module")
def expected() -> tuple[str, ...]:
    return results()


def test_kernels_that_are_not_compiled_hold(monkeypatch: pytest.MonkeyPatch, expected: tuple[str, ...]) -> None:
    monkeypatch.setattr(learners, "kernels", plain_kernels())
    assert first_finding() is None
    assert results() == expected


@pytest.mark.parametrize(
    "mutant", [pytest.param(m, marks=() if k < 6 else pytest.mark.campaign, id=str(m)) for k, m in enumerate(MUTANTS)]
)
def test_a_mutant_is_caught_or_changes_nothing(
    mutant: Mutant, monkeypatch: pytest.MonkeyPatch, expected: tuple[str, ...]
) -> None:
    monkeypatch.setattr(learners, "kernels", plain_kernels(mutant))
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        finding = first_finding()
        changed = finding is not None or _differs(expected)
    assert finding is not None or not changed
    assert finding is None or finding.field  # which names the first that parted


def _differs(expected: tuple[str, ...]) -> bool:
    try:
        return results() != expected
    except Exception:
        return True
