"""The three packages as a library: names for tools that read, for whoever asks, and no import before that."""

import ast
import importlib
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ["pipeline", "replay", "recorders"]


def typed_names(package: str) -> dict[str, str]:
    """Names that a type checker sees, by the source, with their modules."""
    tree = ast.parse((ROOT / package / "__init__.py").read_text())
    guarded = [node for branch in tree.body if isinstance(branch, ast.If) for node in branch.body]
    imports = [node for node in guarded if isinstance(node, ast.ImportFrom)]
    assert all(name.asname == name.name for node in imports for name in node.names)  # exported, not only used
    return {name.name: str(node.module) for node in imports for name in node.names}


@pytest.mark.parametrize("package", PACKAGES)
def test_what_a_type_checker_sees_is_what_there_is(package: str) -> None:
    module, typed = importlib.import_module(package), typed_names(package)
    assert sorted(typed) == module.__all__
    assert set(typed) <= set(dir(module))
    for name, home in typed.items():
        found = getattr(module, name)
        assert found is getattr(importlib.import_module(home), name)
        assert not name.startswith("_")


@pytest.mark.parametrize("package", PACKAGES)
def test_a_name_that_there_is_not_is_no_attribute(package: str) -> None:
    with pytest.raises(AttributeError, match=f"module '{package}' has no attribute 'nothing'"):
        importlib.import_module(package).nothing  # noqa: B018  # asked for


def test_nothing_is_imported_before_it_is_asked_for() -> None:
    program = (
        "import sys, pipeline, replay, recorders\n"
        "early = [name for name in sys.modules if name.split('.')[0] in ('pipeline', 'replay', 'recorders')]\n"
        "from pipeline import LearnerConfig, evaluate_motion, train\n"
        "from replay import Schedule\n"
        "from recorders import LogReader, LogWriter\n"
        "heavy = {'pydrake', 'zenoh', 'rerun', 'matplotlib'} & set(sys.modules)\n"
        "print(sorted(early), sorted(heavy), 'numpy' in sys.modules)\n"
    )
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert run.stdout == "['pipeline', 'recorders', 'recorders.lazy', 'replay'] [] True\n"
