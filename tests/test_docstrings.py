"""Sections of docstrings are numpydoc's: a type after the colon, the description below it."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

import pipeline

ROOT = Path(pipeline.__file__).parent.parent
SECTION = re.compile(r"^(?:Parameters|Attributes)\n-+\n(.*?)(?=^\S+(?: \S+)*\n-+\n|\Z)", re.MULTILINE | re.DOTALL)
ENTRY = re.compile(r"^([*\w]+(?:, [*\w]+)*) : (.*)\n(?!    )", re.MULTILINE)  # without a description below
TYPE = re.compile(
    r"\(?[A-Z]\w*|(?:[a-z_]+\.)+[A-Z]|"
    r"\(?(?:array|array_like|bool|bytes|callable|collection|deque|dict|float|int|iterable|list|mapping|ndarray|object|"
    r"pointers?|sequence|set|str|tuple|type)\b"
)


def descriptions_in_place_of_types(source: str) -> Iterator[str]:
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            for section in SECTION.findall((ast.get_docstring(node) or "") + "\n"):
                for names, text in ENTRY.findall(section + "\n"):
                    if not TYPE.match(text):
                        yield f"{node.name}: {names} : {text}"


@pytest.mark.parametrize("package", ["pipeline", "recorders", "replay"])
def test_types_stand_where_a_documentation_tool_looks_for_them(package: str) -> None:
    modules = sorted((ROOT / package).rglob("*.py"))
    assert len(modules) > 15
    wrong = {path.relative_to(ROOT): list(descriptions_in_place_of_types(path.read_text())) for path in modules}
    assert {path: found for path, found in wrong.items() if found} == {}


def test_a_description_in_place_of_a_type_is_found() -> None:
    section = "Attributes\n    ----------\n    a : int\n    b : how many [s]\n    c : str\n        It."
    source = f'class A:\n    """A.\n\n    {section}\n    """\n'
    assert list(descriptions_in_place_of_types(source)) == ["A: b : how many [s]"]
