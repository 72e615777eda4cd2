"""Bugs planted in the protocol by operators over its syntax tree, and the seeds of the simulation that find them."""

import ast
import hashlib
import importlib
import importlib.abc
import importlib.machinery
import importlib.util
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

from mutation import Mutant, find_mutants, mutated_tree

PACKAGE = "recorders.protocol"

_MOST_TURNS = 100_000  # in one seed, of loops that end by themselves after some tens


class PlantedBug(NamedTuple):
    """A mutant of one of the protocol's modules; `text` is the line that it is on, which names it when lines move."""

    module: str
    text: str
    mutant: Mutant
    nth: int  # among those of the same key

    @property
    def key(self) -> tuple[str, str, str]:
        """What names it in the table of those that change nothing: function, line and change."""
        mutant = self.mutant
        return f"{self.module}.{mutant.function}", self.text, f"{mutant.before} -> {mutant.after or 'nothing'}"

    def __str__(self) -> str:
        return f"{self.module} {self.mutant}"


class EndlessLoopError(Exception):
    """A loop of a mutant does not end."""


def draw_bugs(count: int, *, seed: int) -> list[PlantedBug]:
    """Draw different bugs among all that the operators make of the protocol; what else is there shifts none of them."""

    def drawn(bug: PlantedBug) -> bytes:
        return hashlib.sha256(f"{seed} {bug.key} {bug.nth}".encode()).digest()

    return sorted(all_bugs(), key=drawn)[:count]


def all_bugs() -> Iterator[PlantedBug]:
    """Yield every mutant of what is computed in the protocol's modules."""
    known: Counter[tuple[str, str, str]] = Counter()
    for path in sorted(_folder().rglob("*.py")):
        module = ".".join(path.relative_to(_folder()).with_suffix("").parts)
        source = path.read_text()
        lines = source.splitlines()
        for mutant in find_mutants(source):
            if mutant.function:
                bug = PlantedBug(module, lines[mutant.line - 1].strip(), mutant, 0)
                yield bug._replace(nth=known[bug.key])
                known[bug.key] += 1


def seeds_to_find(bug: PlantedBug, seeds: Sequence[int]) -> int | None:
    """Return how many of the seeds it takes until one breaks a promise because of a bug; None if none does."""
    try:
        with planted(bug) as simulation:
            for count, seed in enumerate(seeds, 1):
                _turns.clear()
                if simulation.run_seed(seed).broken:
                    return count
    except Exception:  # it cannot even be imported
        return 1
    return None


@contextmanager
def planted(bug: PlantedBug) -> Iterator[Any]:
    """Import the simulation over a protocol that has a bug; what others imported stays as it is."""
    kept = {name: module for name, module in sys.modules.items() if _is_concerned(name)}
    for name in kept:
        del sys.modules[name]
    finder = _Finder(bug)
    sys.meta_path.insert(0, finder)
    try:
        yield importlib.import_module("simulation.run")
    finally:
        sys.meta_path.remove(finder)
        for name in [name for name in sys.modules if _is_concerned(name)]:
            del sys.modules[name]
        sys.modules.update(kept)


class _Finder(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Finds one module of the protocol, and runs its mutant instead."""

    def __init__(self, bug: PlantedBug) -> None:
        self._bug = bug

    def find_spec(self, name: str, path: object, target: object = None) -> importlib.machinery.ModuleSpec | None:
        """Find the module that has the bug, and no other."""
        if name != f"{PACKAGE}.{self._bug.module}":
            return None
        return importlib.util.spec_from_loader(name, self)

    def exec_module(self, module: ModuleType) -> None:
        """Run the mutant; its loops end."""
        source = (_folder() / f"{self._bug.module.replace('.', '/')}.py").read_text()
        tree = _Counting().visit(mutated_tree(source, self._bug.mutant))
        module.__dict__["_count_turn"] = _count_turn
        exec(compile(ast.fix_missing_locations(tree), str(self._bug), "exec"), module.__dict__)


class _Counting(ast.NodeTransformer):
    """Has every turn of a `while` loop counted."""

    def visit_While(self, node: ast.While) -> ast.While:  # as `ast` names it
        """Count at the beginning of each turn."""
        self.generic_visit(node)
        node.body.insert(0, ast.Expr(ast.Call(ast.Name("_count_turn", ast.Load()), [], [])))
        return node


_turns: Counter[str] = Counter()


def _count_turn() -> None:
    _turns["of this seed"] += 1
    if _turns.total() > _MOST_TURNS:
        raise EndlessLoopError


def _is_concerned(name: str) -> bool:
    return name.startswith(PACKAGE) or name.split(".")[0] == "simulation"


def _folder() -> Path:
    spec = importlib.util.find_spec(PACKAGE)
    assert spec is not None
    assert spec.origin is not None
    return Path(spec.origin).parent
