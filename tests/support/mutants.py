"""Mutants of the kernels of the rule `forward-inverse`: one operator or number changed in their syntax tree."""

import ast
import inspect
import random
from collections.abc import Iterator
from types import ModuleType
from typing import NamedTuple

from pipeline.learner.rules.forward_inverse import kernels

OPERATORS: dict[type, type] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.Lt: ast.GtE,
    ast.Gt: ast.LtE,
    ast.LtE: ast.Gt,
    ast.GtE: ast.Lt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
    ast.And: ast.Or,
}


_DEVIATIONS = ("expect", "fit_errors")


class Mutant(NamedTuple):
    """A change: where, what it was, and what it is."""

    line: int
    place: int  # among the nodes of the tree
    before: str
    after: str

    def __str__(self) -> str:
        return f"line {self.line}, {self.place}: {self.before} -> {self.after}"

    def module(self) -> ModuleType:
        """The kernels with this change, not compiled."""
        tree = ast.parse(_SOURCE)
        _change(list(_nodes(tree))[self.place])
        return _module(tree)


def draw_mutants(count: int, *, seed: int) -> list[Mutant]:
    """Draw different changes of the kernels."""
    found = [mutant for place, node in enumerate(_nodes(ast.parse(_SOURCE))) if (mutant := _mutant(place, node))]
    return random.Random(seed).sample(found, count)


def plain_kernels() -> ModuleType:
    """The kernels as they are, not compiled."""
    return _module(ast.parse(_SOURCE))


def _nodes(tree: ast.Module) -> Iterator[ast.AST]:
    """All that is computed in compiled functions, but for deviations, which enter neither outputs nor state."""
    for function in tree.body:
        if isinstance(function, ast.FunctionDef) and function.decorator_list and function.name not in _DEVIATIONS:
            for statement in function.body:
                yield from ast.walk(statement)


def _mutant(place: int, node: ast.AST) -> Mutant | None:
    before = ast.unparse(node)
    if not _change(node):
        return None
    return Mutant(getattr(node, "lineno", 0), place, before, ast.unparse(node))


def _change(node: ast.AST) -> bool:
    """Change an operator or a number; False if the node has none."""
    if isinstance(node, ast.BinOp | ast.AugAssign | ast.BoolOp) and type(node.op) in OPERATORS:
        node.op = OPERATORS[type(node.op)]()
    elif isinstance(node, ast.Compare) and type(node.ops[0]) in OPERATORS:
        node.ops[0] = OPERATORS[type(node.ops[0])]()
    elif isinstance(node, ast.Constant) and isinstance(node.value, int | float) and type(node.value) is not bool:
        node.value += 1
    else:
        return False
    return True


def _module(tree: ast.Module) -> ModuleType:
    for function in tree.body:
        if isinstance(function, ast.FunctionDef):
            function.decorator_list = []
    module = ModuleType("mutant")
    exec(compile(tree, "mutant", "exec"), module.__dict__)
    return module


_SOURCE = inspect.getsource(kernels)
