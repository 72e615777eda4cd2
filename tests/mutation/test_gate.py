"""The mutation gate: a mutant that a test notices is killed, and what is known of mutants is true."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from mutant_codes import changed_functions, statement_at
from mutant_forks import OUT_OF_TIME, Task, run_in_forks
from mutant_session import Measured
from mutant_table import Equivalent, drawn, equivalents, mutated_modules, stale
from mutation import find_mutants, mutated_tree

ROOT = Path(__file__).parents[2]
MODULES = {module.name: module for module in mutated_modules()}


def test_files_and_tests_of_every_module_are_there() -> None:
    for module in MODULES.values():
        assert all((ROOT / file).is_file() for file in module.files)
        assert all((ROOT / test.partition("::")[0]).exists() for test in module.tests)
    files = [file for module in MODULES.values() for file in module.files]
    assert len(files) == len(set(files))


def test_every_mutant_that_is_known_to_change_nothing_is_one_and_has_its_reason() -> None:
    assert stale(equivalents(), list(MODULES.values())) == []


def test_an_entry_that_names_no_mutant_is_found() -> None:
    job = MODULES["digests"].jobs()[0]
    gone = Equivalent(job.file, "x = 1", ("number: 1 -> 2",), "it was there")
    assert stale([gone], [MODULES["digests"]]) == [f"{job.file}: 'x = 1', 'number: 1 -> 2'"]


def test_the_same_seed_draws_the_same_mutants() -> None:
    jobs = MODULES["ticks"].jobs()
    assert drawn(jobs, sample=20, seed=1) == drawn(MODULES["ticks"].jobs(), sample=20, seed=1)
    assert drawn(jobs, sample=20, seed=1) != drawn(jobs, sample=20, seed=2)
    assert drawn(jobs, sample=None, seed=1) == jobs


@pytest.mark.parametrize(
    ("change", "in_functions"), [("1 -> 2", False), ("a + 2 -> a - 2", True), ("3 -> 4", False), ("5 -> 6", True)]
)
def test_what_a_change_concerns(change: str, in_functions: bool) -> None:
    source = "x = 1\ndef f(a):\n    return a + 2\nclass C:\n    y = 3\n    def g(self):\n        return lambda: 5\n"
    mutant = next(mutant for mutant in find_mutants(source) if str(mutant).endswith(change))
    codes = changed_functions(compile(source, "f", "exec"), compile(mutated_tree(source, mutant), "f", "exec"))
    assert (codes is not None) == in_functions


def test_a_statement_is_its_lines_or_its_head() -> None:
    source = "if (a and\n    b):\n    c(\n        d)\n"
    assert [statement_at(source, line) for line in (1, 2, 3, 4)] == [range(1, 3), range(1, 3), range(3, 5), range(3, 5)]


def test_tests_of_a_change_are_those_that_reach_it_and_of_a_constant_also_those_that_reach_nothing() -> None:
    seconds = {"slow": 2.0, "quick": 1.0, "elsewhere": 0.5, "constant": 3.0}
    lines = {"a.py": {"slow": [3, 4], "quick": [4]}, "b.py": {"elsewhere": [1]}}
    found = Measured("", seconds, lines)
    assert [found.tests_of("a.py", range(*span)) for span in ((3, 4), (3, 5), (5, 9))] == [
        ["slow"],
        ["quick", "slow"],
        [],
    ]
    assert found.tests_of("a.py", None) == ["quick", "slow", "constant"]


def test_what_does_not_end_is_ended() -> None:
    def endless() -> None:
        while True:
            pass

    results: dict[str, Any] = {}
    tasks = [
        ("endless", Task(endless, 1)),
        ("long", Task(lambda: "x" * 1_000_000, 9)),
        ("wrong", Task(lambda: 1 // 0, 9)),
    ]
    run_in_forks(tasks, processes=2, done=results.__setitem__)
    assert results["endless"] == OUT_OF_TIME
    assert results["long"] == "x" * 1_000_000
    assert "ZeroDivisionError" in results["wrong"]


def test_a_few_mutants_of_the_digests_are_killed() -> None:
    found = subprocess.run(
        [sys.executable, str(ROOT / "tests/mutation/campaign.py"), "digests", "--sample", "4", "--out", "sample"],
        capture_output=True,
        text=True,
        cwd=ROOT,
    )
    assert found.returncode == 0, found.stdout
    result = json.loads((ROOT / "out/mutants/sample/digests.json").read_text())
    assert len(result["outcomes"]) == 4
    assert all(row["test"].startswith("tests/") for row in result["outcomes"])
