"""Mutants of any source text: one operator, number, condition or statement of its syntax tree changed at a time."""

import ast
import copy
from collections.abc import Callable, Iterator
from typing import NamedTuple, TypeAlias

Edits: TypeAlias = Iterator[ast.AST]
"""What an operator puts in the place of a node, one after the other; none where it has nothing to change."""

_BOUNDARY = {ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt}
_OPPOSITE = {
    ast.Lt: ast.GtE,
    ast.GtE: ast.Lt,
    ast.Gt: ast.LtE,
    ast.LtE: ast.Gt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot,
    ast.IsNot: ast.Is,
    ast.In: ast.NotIn,
    ast.NotIn: ast.In,
}
_ARITHMETIC = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.FloorDiv,
    ast.FloorDiv: ast.Mult,
    ast.Div: ast.Mult,
    ast.Mod: ast.FloorDiv,
    ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd,
    ast.BitXor: ast.BitAnd,
    ast.LShift: ast.RShift,
    ast.RShift: ast.LShift,
}
_FUNCTIONS = {"min": "max", "max": "min", "any": "all", "all": "any"}


class SyntaxMutant(NamedTuple):
    """One change of a source text: which operator made it, where, what stood there and what stands there now.

    `text` is the source line, without its indent: it names the place when lines have moved.
    """

    operator: str
    place: int  # among the nodes that may be changed
    variant: int  # of what the operator makes of this node
    line: int
    text: str
    before: str
    after: str

    def __str__(self) -> str:
        return f"line {self.line}, {self.operator}: {self.before!r} -> {self.after!r}"


def syntax_mutants(source: str) -> list[SyntaxMutant]:
    """Return every mutant of a source text, in the order of its nodes."""
    found, lines = [], source.splitlines()
    for place, node in enumerate(changeable(ast.parse(source))):
        line = node.target.lineno if isinstance(node, ast.comprehension) else getattr(node, "lineno", 1)
        for name, operator in OPERATORS.items():
            for variant, edit in enumerate(operator(node)):
                texts = _short(node), _short(edit)
                found.append(SyntaxMutant(name, place, variant, line, lines[line - 1].strip(), *texts))
    return found


def mutated_tree(source: str, mutant: SyntaxMutant) -> ast.Module:
    """Return the syntax tree of a source text with one change, ready to be compiled."""
    tree = ast.parse(source)
    node = list(changeable(tree))[mutant.place]
    edit = list(OPERATORS[mutant.operator](node))[mutant.variant]
    changed = _Replacing(node, edit).visit(tree)
    assert isinstance(changed, ast.Module)
    return ast.fix_missing_locations(changed)


def changeable(tree: ast.Module) -> Iterator[ast.AST]:
    """Yield all that is computed in functions: no annotation, docstring, decorator or error message."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.FunctionDef):
            for statement in node.body:
                yield from _inside(statement)
        elif isinstance(node, ast.ClassDef):
            yield from changeable(ast.Module(node.body, []))


def _inside(node: ast.AST) -> Iterator[ast.AST]:
    if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
        return
    yield node
    if isinstance(node, ast.Raise | ast.JoinedStr | ast.FunctionDef | ast.Lambda):
        if isinstance(node, ast.FunctionDef):
            for statement in node.body:
                yield from _inside(statement)
        elif isinstance(node, ast.Lambda):
            yield from _inside(node.body)
        return
    for name, value in ast.iter_fields(node):
        if name == "annotation":
            continue
        for child in value if isinstance(value, list) else [value]:
            if isinstance(child, ast.AST):
                yield from _inside(child)


def _compared(node: ast.AST) -> Edits:
    """A limit that is in or out, and the opposite of what is asked."""
    if not isinstance(node, ast.Compare):
        return
    for at, found in enumerate(node.ops):
        for table in (_BOUNDARY, _OPPOSITE):
            if type(found) in table:
                edit = copy.deepcopy(node)
                edit.ops[at] = table[type(found)]()
                yield edit


def _arithmetic(node: ast.AST) -> Edits:
    """Another operator between numbers, or sets."""
    if isinstance(node, ast.BinOp | ast.AugAssign) and type(node.op) in _ARITHMETIC:
        edit = copy.deepcopy(node)
        edit.op = _ARITHMETIC[type(node.op)]()
        yield edit


def _logic(node: ast.AST) -> Edits:
    """`or` for `and`, one operand left out, and `not` taken away."""
    if isinstance(node, ast.BoolOp):
        yield ast.BoolOp(ast.Or() if isinstance(node.op, ast.And) else ast.And(), node.values)
        for at in range(len(node.values)):
            rest = node.values[:at] + node.values[at + 1 :]
            yield rest[0] if len(rest) == 1 else ast.BoolOp(node.op, rest)
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
        yield node.operand


def _constant(node: ast.AST) -> Edits:
    """Numbers one off, and truth for falsehood."""
    if isinstance(node, ast.Constant):
        if isinstance(node.value, bool):
            yield ast.Constant(not node.value)
        elif isinstance(node.value, int | float):
            yield ast.Constant(node.value + 1)
            if node.value:
                yield ast.Constant(node.value - 1)


def _slices(node: ast.AST) -> Edits:
    """Cuts that are one element off."""
    if isinstance(node, ast.Slice):
        for name in ("lower", "upper"):
            bound = getattr(node, name)
            if bound is not None and not isinstance(bound, ast.Constant):
                edit = copy.deepcopy(node)
                setattr(edit, name, ast.BinOp(bound, ast.Add(), ast.Constant(1)))
                yield edit


def _condition(node: ast.AST) -> Edits:
    """Branches swapped, or a condition that always holds or never."""
    if isinstance(node, ast.If | ast.IfExp):
        edit = copy.deepcopy(node)
        edit.test = ast.UnaryOp(ast.Not(), node.test)
        yield edit
        for value in (True, False):
            edit = copy.deepcopy(node)
            edit.test = ast.Constant(value)
            yield edit
    elif isinstance(node, ast.comprehension) and node.ifs:
        yield ast.comprehension(node.target, node.iter, [], node.is_async)


def _statement(node: ast.AST) -> Edits:
    """A statement left out; an assignment only if its names live on."""
    if isinstance(node, ast.Assign):
        left_out = all(isinstance(target, ast.Attribute) for target in _targets(node))
    else:
        left_out = isinstance(node, ast.Expr | ast.AugAssign | ast.Raise | ast.Delete | ast.Break | ast.Continue)
    if left_out:
        yield ast.Pass()


def _returned(node: ast.AST) -> Edits:
    """A return left out, and nothing returned where something is."""
    if isinstance(node, ast.Return):
        yield ast.Pass() if node.value is None else ast.Expr(node.value)
        if node.value is not None and not (isinstance(node.value, ast.Constant) and node.value.value is None):
            yield ast.Return(ast.Constant(None))


def _function(node: ast.AST) -> Edits:
    """The least for the most, any for all, and an argument by name left out."""
    if not isinstance(node, ast.Call):
        return
    if isinstance(node.func, ast.Name) and node.func.id in _FUNCTIONS:
        edit = copy.deepcopy(node)
        edit.func = ast.Name(_FUNCTIONS[node.func.id], ast.Load())
        yield edit
    for at, keyword in enumerate(node.keywords):
        if keyword.arg is not None:
            edit = copy.deepcopy(node)
            del edit.keywords[at]
            yield edit


OPERATORS: dict[str, Callable[[ast.AST], Edits]] = {
    "comparison": _compared,
    "arithmetic": _arithmetic,
    "logic": _logic,
    "constant": _constant,
    "slice": _slices,
    "condition": _condition,
    "statement": _statement,
    "return": _returned,
    "function": _function,
}


def _targets(node: ast.Assign) -> list[ast.expr]:
    found: list[ast.expr] = []
    for target in node.targets:
        found += target.elts if isinstance(target, ast.Tuple) else [target]
    return found


def _short(node: ast.AST) -> str:
    """Return a node as source on one line; of a compound statement, its first line."""
    return ast.unparse(node).partition("\n")[0]


class _Replacing(ast.NodeTransformer):
    """Puts one node in the place of another."""

    def __init__(self, old: ast.AST, new: ast.AST) -> None:
        self._old, self._new = old, new

    def visit(self, node: ast.AST) -> ast.AST:
        """Return the new node for the old one, and any other with what it holds."""
        return self._new if node is self._old else self.generic_visit(node)
