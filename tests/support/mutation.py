"""Mutants of a source text: one operator, number, condition or statement changed in its syntax tree."""

import ast
import sys
from collections.abc import Callable, Iterator
from types import ModuleType
from typing import NamedTuple

_ARITHMETIC: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.FloorDiv: ast.Mult,
    ast.Mod: ast.FloorDiv,
    ast.Pow: ast.Mult,
    ast.LShift: ast.RShift,
    ast.RShift: ast.LShift,
    ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd,
    ast.BitXor: ast.BitAnd,
}
_NEGATED: dict[type[ast.cmpop], type[ast.cmpop]] = {
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
_BOUNDARY: dict[type[ast.cmpop], type[ast.cmpop]] = {ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt}
_OTHER_FUNCTION = {"min": "max", "max": "min", "any": "all", "all": "any"}

_NOT_COMPUTED = {"annotation", "returns", "decorator_list", "type_params", "bases", "keywords"}


class Mutant(NamedTuple):
    """A change of a source text: where, by which operator, what was there, and what is there instead."""

    line: int
    operator: str
    before: str
    after: str
    function: str  # dotted name of the function or class that it is in; empty at the module's level
    place: int  # among the nodes that may change
    variant: int  # among the changes of that node

    def __str__(self) -> str:
        return f"line {self.line}, {self.operator}: {self.before} -> {self.after or 'nothing'}"


class _Site(NamedTuple):
    """A node where it stands: `parent.field`, or `parent.field[position]`."""

    parent: ast.AST
    field: str
    position: int | None
    node: ast.AST
    function: str

    @property
    def line(self) -> int:
        return getattr(self.node, "lineno", 0)

    def put(self, node: ast.AST) -> None:
        if self.position is None:
            setattr(self.parent, self.field, node)
        else:
            getattr(self.parent, self.field)[self.position] = node


def find_mutants(source: str) -> list[Mutant]:
    """Return every mutant of a module's text, in the order of the text.

    Nothing is changed in docstrings, annotations, decorators, f-strings, assertions, the words of errors that are
    raised, and strings.

    Examples
    --------
    >>> [str(mutant) for mutant in find_mutants("def double(x): return x * 2")]
    ['line 1, return: return x * 2 -> return None', 'line 1, arithmetic: x * 2 -> x / 2', 'line 1, number: 2 -> 3']
    """
    return [
        Mutant(
            getattr(site.node, "lineno", 0), operator, _text(site.node), _text(changed), site.function, place, variant
        )
        for place, site in enumerate(_sites(ast.parse(source)))
        for variant, (operator, changed) in enumerate(_changes(site))
    ]


def mutated_tree(source: str, mutant: Mutant) -> ast.Module:
    """Return the syntax tree with one change; lines are numbered as in the text.

    Raises
    ------
    ValueError
        If the mutant is of another text.
    """
    tree = ast.parse(source)
    sites = list(_sites(tree))
    site = sites[mutant.place] if mutant.place < len(sites) else None
    changes = list(_changes(site)) if site else []
    if site is None or mutant.variant >= len(changes) or _text(site.node) != mutant.before:
        raise ValueError(f"mutant: expected one of this text, found {mutant}")
    site.put(ast.copy_location(changes[mutant.variant][1], site.node))
    return ast.fix_missing_locations(tree)


def mutated_source(source: str, mutant: Mutant) -> str:
    """Return the text with one change, without comments."""
    return ast.unparse(mutated_tree(source, mutant)) + "\n"


def mutated_module(
    source: str, mutant: Mutant, *, name: str, prepare: Callable[[ast.Module], None] | None = None
) -> ModuleType:
    """Return a module that was run from the text with one change; the module of that name stays as it is.

    Parameters
    ----------
    source : str
        The module's text.
    mutant : Mutant
        The change.
    name : str
        The module's dotted name: what it imports relatively, and what its classes' `__module__` names.
    prepare : callable, optional
        Changes the tree further before it is compiled.
    """
    tree = mutated_tree(source, mutant)
    if prepare is not None:
        prepare(tree)
    return module_of_tree(tree, name=name)


def module_of_tree(tree: ast.Module, *, name: str) -> ModuleType:
    """Return a module that was run from a syntax tree, under a name that others have it by while it runs."""
    module = ModuleType(name)
    module.__package__ = name.rpartition(".")[0]
    original = sys.modules.get(name)
    sys.modules[name] = module  # dataclasses look their module up
    try:
        exec(compile(tree, f"<{name}>", "exec"), module.__dict__)
    finally:
        if original is None:
            del sys.modules[name]
        else:
            sys.modules[name] = original
    return module


def _sites(tree: ast.Module) -> list[_Site]:
    return list(_sites_below(tree, function=""))


def _sites_below(parent: ast.AST, *, function: str) -> Iterator[_Site]:
    """Walk depth first, in the order of the text."""
    for field, value in ast.iter_fields(parent):
        if _is_computed(parent, field):
            children = value if isinstance(value, list) else [value]
            for index, node in enumerate(children):
                if isinstance(node, ast.AST) and not _is_left_alone(node):
                    yield _Site(parent, field, index if isinstance(value, list) else None, node, function)
                    yield from _sites_below(node, function=_inner(function, node))


def _is_computed(parent: ast.AST, field: str) -> bool:
    if field in _NOT_COMPUTED:
        return field == "keywords" and isinstance(parent, ast.Call)
    return not isinstance(parent, ast.Raise)


def _is_left_alone(node: ast.AST) -> bool:
    """Docstrings, f-strings, assertions, and what runs for type checkers alone."""
    match node:
        case ast.Expr(value=ast.Constant()) | ast.JoinedStr() | ast.Assert() | ast.expr_context() | ast.Import():
            return True
        case ast.If(test=ast.Name(id="TYPE_CHECKING")) | ast.ImportFrom():
            return True
    return False


def _inner(function: str, node: ast.AST) -> str:
    if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
        return f"{function}.{node.name}".lstrip(".")
    return function


def _changes(site: _Site) -> Iterator[tuple[str, ast.AST]]:
    """Every change of one node, with its operator's name."""
    node = site.node
    if isinstance(node, ast.stmt):
        yield from _statement_changes(node)
    elif isinstance(node, ast.expr):
        if _is_condition(site) and not isinstance(node, ast.Compare | ast.BoolOp | ast.Constant) and not _is_not(node):
            yield "condition", ast.UnaryOp(ast.Not(), node)
        yield from _expression_changes(node)


def _is_condition(site: _Site) -> bool:
    return site.field == "ifs" or (site.field == "test" and isinstance(site.parent, ast.If | ast.While | ast.IfExp))


def _is_not(node: ast.AST) -> bool:
    return isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not)


def _statement_changes(node: ast.stmt) -> Iterator[tuple[str, ast.AST]]:
    match node:
        case ast.Return(value=value) if value is not None and not isinstance(value, ast.Constant):
            yield "return", ast.Return(ast.Constant(None))
        case ast.Raise() | ast.Delete() | ast.Expr(value=ast.Call()):
            yield "removal", ast.Pass()
        case ast.Assign(targets=[ast.Attribute() | ast.Subscript(), *_]):
            yield "removal", ast.Pass()
        case ast.AugAssign(target=target, op=op, value=value):
            yield "removal", ast.Pass()
            if type(op) in _ARITHMETIC:
                yield "arithmetic", ast.AugAssign(target, _ARITHMETIC[type(op)](), value)
        case ast.Break():
            yield "loop", ast.Continue()
        case ast.Continue():
            yield "loop", ast.Break()


def _expression_changes(node: ast.expr) -> Iterator[tuple[str, ast.AST]]:
    match node:
        case ast.BinOp(left, op, right) if type(op) in _ARITHMETIC:
            yield "arithmetic", ast.BinOp(left, _ARITHMETIC[type(op)](), right)
        case ast.UnaryOp(op=ast.Not() | ast.USub() | ast.Invert(), operand=operand):
            yield "sign", operand
        case ast.BoolOp(op, values):
            yield "logic", ast.BoolOp(ast.Or() if isinstance(op, ast.And) else ast.And(), values)
        case ast.Compare():
            yield from _compare_changes(node)
        case ast.Call(func=ast.Name(id=name), args=arguments, keywords=keywords) if name in _OTHER_FUNCTION:
            yield "function", ast.Call(ast.Name(_OTHER_FUNCTION[name], ast.Load()), arguments, keywords)
        case ast.Constant(value=bool(value)):
            yield "truth", ast.Constant(not value)
        case ast.Constant(value=int() | float() as value):
            yield "number", ast.Constant(value + 1)
        case ast.Constant(value=bytes(value)):
            yield "bytes", ast.Constant(value + b"\0")


def _compare_changes(node: ast.Compare) -> Iterator[tuple[str, ast.AST]]:
    for operator, table in (("comparison", _NEGATED), ("boundary", _BOUNDARY)):
        for index, op in enumerate(node.ops):
            if type(op) in table:
                ops = [table[type(op)]() if k == index else other for k, other in enumerate(node.ops)]
                yield operator, ast.Compare(node.left, ops, node.comparators)


def _text(node: ast.AST) -> str:
    return "" if isinstance(node, ast.Pass) else ast.unparse(node)
