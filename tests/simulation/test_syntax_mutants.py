"""Mutants of source texts: each is one change that compiles, is named by its line, and leaves the rest as it was."""

import ast
import inspect

import syntax_mutants as module
from syntax_mutants import OPERATORS, mutated_tree, syntax_mutants

SOURCE = '''
"""Words that stay."""
LIMIT = 3

class Window:
    """More of them."""

    def take(self, frame: "tuple[int, 4]") -> int | None:
        if self.closed or not self.room(LIMIT, size=4):
            raise ValueError(f"full after {3 + 4}")
        for part in frame[self.first :]:
            self.count += min(part.size - 1, 9)
        return None if self.count == 0 else self.count
'''


def test_every_mutant_is_one_change_and_another_program() -> None:
    found = syntax_mutants(SOURCE)
    assert {mutant.operator for mutant in found} == set(OPERATORS)
    programs = [ast.unparse(mutated_tree(SOURCE, mutant)) for mutant in found]
    right = ast.unparse(ast.parse(SOURCE))
    assert right not in programs
    for mutant, program in zip(found, programs, strict=True):
        compile(program, "mutant", "exec")
        changed = [pair for pair in zip(right.splitlines(), program.splitlines(), strict=False) if len(set(pair)) == 2]
        assert changed, mutant
        assert mutant.text == SOURCE.splitlines()[mutant.line - 1].strip()
        for words in ("Words that stay", "More of them", "tuple[int, 4]", "LIMIT = 3"):
            assert words in program


def test_mutants_are_the_same_each_time_and_apart_from_each_other() -> None:
    source = inspect.getsource(module)
    found = syntax_mutants(source)
    assert found == syntax_mutants(source)
    assert len(set(found)) == len(found) > 100
