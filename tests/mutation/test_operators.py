"""Mutants of a text: each is another program, each can be made again, and what nothing depends on stays as it is."""

import ast
import doctest
import inspect

import mutation
import pytest
from mutation import Mutant, find_mutants, mutated_module, mutated_source

from replay.sources import stream_digest
from replay.sources.stream_digest import StreamDigest

SOURCE = inspect.getsource(stream_digest)


def changes(source: str) -> list[tuple[str, str, str]]:
    return [(mutant.operator, mutant.before, mutant.after) for mutant in find_mutants(source)]


@pytest.mark.parametrize(
    ("source", "expected"),
    [
        ("a + b", [("arithmetic", "a + b", "a - b")]),
        ("a <= b", [("comparison", "a <= b", "a > b"), ("boundary", "a <= b", "a < b")]),
        ("a is None", [("comparison", "a is None", "a is not None")]),
        ("a and b", [("logic", "a and b", "a or b")]),
        ("not a", [("sign", "not a", "a")]),
        ("a if b else c", [("condition", "b", "not b")]),
        ("f()", [("removal", "f()", "")]),
        ("a.b = c", [("removal", "a.b = c", "")]),
        ("a -= b", [("removal", "a -= b", ""), ("arithmetic", "a -= b", "a += b")]),
        ("raise E('words')", [("removal", "raise E('words')", "")]),
        ("x = min(a, b)", [("function", "min(a, b)", "max(a, b)")]),
        ("x = True", [("truth", "True", "False")]),
        ("x = 3", [("number", "3", "4")]),
        ("x = b'a'", [("bytes", "b'a'", "b'a\\x00'")]),
        ("for a in b:\n    break", [("loop", "break", "continue")]),
    ],
)
def test_each_operator_changes_one_thing(source: str, expected: list[tuple[str, str, str]]) -> None:
    assert changes(source) == expected


@pytest.mark.parametrize(
    "source",
    [
        '"""Docstring."""',
        "x: int | None",
        "@decorator(1)\ndef f(x: int = None) -> int | None: pass",
        "x = f'{a + 1}'",
        "assert a + 1",
        "if TYPE_CHECKING:\n    x = 1",
        "x = 'words'",
    ],
)
def test_what_computes_nothing_stays(source: str) -> None:
    assert changes(source) == []


def test_every_mutant_is_another_program_that_compiles() -> None:
    mutants = find_mutants(SOURCE)
    texts = {mutated_source(SOURCE, mutant) for mutant in mutants}
    assert len(texts) == len(mutants) > 10
    assert ast.unparse(ast.parse(SOURCE)) + "\n" not in texts
    for text in texts:
        compile(text, "mutant", "exec")


def test_a_mutant_says_where_it_is() -> None:
    mutant = next(m for m in find_mutants(SOURCE) if m.before == "value + data")
    assert mutant.function == "StreamDigest.extend"
    assert "value + data" in SOURCE.splitlines()[mutant.line - 1]


def test_a_mutated_module_runs_beside_the_module_itself() -> None:
    mutant = next(m for m in find_mutants(SOURCE) if m.before == "self._value = value" and "extend" in m.function)
    changed, plain = mutated_module(SOURCE, mutant, name=stream_digest.__name__).StreamDigest(), StreamDigest()
    for digest in (changed, plain):
        digest.extend([b"tick"])
    assert changed.value == bytes(32) != plain.value


def test_a_mutant_of_another_text_is_refused() -> None:
    mutant = Mutant(line=1, operator="number", before="1", after="2", function="", place=0, variant=0)
    with pytest.raises(ValueError, match=r"expected one of this text, found line 1, number: 1 -> 2"):
        mutated_module("x = 2", mutant, name="anything")


def test_the_example_holds() -> None:
    assert doctest.testmod(mutation).attempted == 1
    assert doctest.testmod(mutation).failed == 0
