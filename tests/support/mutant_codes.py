"""What a mutant changes of a module that is imported: the code of some functions, or more than that."""

import ast
import gc
import importlib.abc
import importlib.machinery
import inspect
import sys
from collections.abc import Iterator, Sequence
from importlib.machinery import ModuleSpec
from types import CodeType, FunctionType, ModuleType
from typing import TypeAlias

Place: TypeAlias = tuple[str, int]
"""Qualified name and first line of a function."""


def functions_of(path: str) -> list[FunctionType]:
    """Return every function that was made from a file."""
    return [found for found in gc.get_objects() if type(found) is FunctionType and found.__code__.co_filename == path]


def changed_functions(before: CodeType, after: CodeType) -> dict[Place, CodeType] | None:
    """Return the codes of a module's functions after a change; None if more than functions has changed."""
    pairs = list(zip(_codes(before), _codes(after), strict=False))
    if len(pairs) != len(list(_codes(after))) or any(_own(a) != _own(b) for a, b in pairs if not _is_function(a)):
        return None
    return {place_of(code): code for _, code in pairs if _is_function(code)}


def place_of(code: CodeType) -> Place:
    """Return what names a function's code within its file."""
    return code.co_qualname, code.co_firstlineno


def take_on(functions: Sequence[FunctionType], codes: dict[Place, CodeType]) -> None:
    """Give functions their changed code: whoever has imported them runs it."""
    for function in functions:
        function.__code__ = codes.get(place_of(function.__code__), function.__code__)


def statement_at(source: str, line: int) -> range:
    """Return the lines of the innermost statement at a line; of a compound one, of its head."""
    spans = [_span(node) for node in ast.walk(ast.parse(source)) if isinstance(node, ast.stmt)]
    return min((span for span in spans if line in span), key=len)


class ChangedModule(importlib.abc.MetaPathFinder):
    """Import hook: one module is run from a syntax tree in place of its file."""

    def __init__(self, name: str, tree: ast.Module) -> None:
        self._name, self._tree = name, tree

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Find the module's own file, and have it loaded from the tree."""
        if fullname != self._name:
            return None
        spec = importlib.machinery.PathFinder.find_spec(fullname, path, target)
        assert spec is not None
        assert spec.origin is not None
        spec.loader = _TreeLoader(fullname, spec.origin, self._tree)
        return spec


class _TreeLoader(importlib.machinery.SourceFileLoader):
    def __init__(self, fullname: str, path: str, tree: ast.Module) -> None:
        super().__init__(fullname, path)
        self._tree = tree

    def get_code(self, fullname: str) -> CodeType:
        code = compile(self._tree, self.path, "exec")
        assert isinstance(code, CodeType)
        return code


def forget_modules(root: str, *, but: Sequence[str]) -> None:
    """Forget all modules from files below a folder, but some, so that they are imported anew."""
    for name, module in list(sys.modules.items()):
        file = getattr(module, "__file__", None) or ""
        if file.startswith(root) and "/site-packages/" not in file and name not in but:
            del sys.modules[name]


def _codes(code: CodeType) -> Iterator[CodeType]:
    yield code
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _codes(constant)


def _is_function(code: CodeType) -> bool:
    return bool(code.co_flags & inspect.CO_NEWLOCALS and code.co_flags & inspect.CO_OPTIMIZED)


def _own(code: CodeType) -> tuple[object, ...]:
    """Return what a code does itself, without that of the functions in it."""
    constants = [None if isinstance(constant, CodeType) else repr(constant) for constant in code.co_consts]
    return code.co_code, code.co_names, constants


def _span(node: ast.stmt) -> range:
    body = getattr(node, "body", None)
    last = body[0].lineno - 1 if body else node.end_lineno or node.lineno
    return range(node.lineno, max(last, node.lineno) + 1)
