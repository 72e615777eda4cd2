"""TOML that would take much of the machine is refused before it is parsed; everything else reads as ever."""

import tomllib

import pytest
from hypothesis import given
from hypothesis import strategies as st
from peak_memory import peak_memory_mb

from pipeline.resources import data_path
from pipeline.robot.toml_text import MAX_BYTES, MAX_DEPTH, parse_toml
from recorders.errors import ConfigError

DEEP = {
    "dotted": ".".join("a" * 16_000) + " = 1",
    "dotted with spaces": " . ".join("a" * 8_000) + " = 1",
    "quoted": ".".join(['"a.b"'] * 5_000) + " = 1",
    "literal": ".".join(["'a'"] * 5_000) + " = 1",
    "header": f"[{'.'.join('a' * 16_000)}]",
    "header of a list": f"[[{'.'.join('a' * 16_000)}]]",
    "in an inline table": "a = {" + ".".join("a" * 16_000) + " = 1}",
    "after a text in four quotes": 'a = ["""b"""", {' + ".".join("a" * 16_000) + ' = 1}, "c"]',
    "after an empty text": 'a = ["""""", {' + ".".join("a" * 16_000) + " = 1}]",
    "after a quote in a comment": "a = 1  # it's\n" + ".".join("a" * 16_000) + " = 1",
    "lists": "a = " + "[" * 16_000,
    "tables": "a = " + "{a = " * 6_000,
    "lists and tables": "a = " + "[{a = " * 5_000,
}


@pytest.mark.parametrize("name", DEEP)
def test_what_is_nested_deeply_is_refused(name: str) -> None:
    with pytest.raises(ConfigError, match=f"^settings: expected .* nested at most {MAX_DEPTH} deep, found"):
        parse_toml(DEEP[name], "settings", error=ConfigError)


def test_no_such_text_takes_much_memory() -> None:
    read = (
        "import sys; from pipeline.robot.toml_text import parse_toml; from recorders.errors import ConfigError\n"
        "for text in sys.stdin.read().split('\\0'):\n"
        "    try: parse_toml(text, 'settings', error=ConfigError)\n"
        "    except ConfigError: pass\n"
        "    else: sys.exit('accepted')"
    )
    texts = [*DEEP.values(), '"\\' * 16_000, "'" * 31_999, '"' * 31_999]
    assert peak_memory_mb(read, text="\0".join(texts)) < 100


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a = 1\n" * (MAX_BYTES // 6 + 1), "settings: expected at most 32768 bytes, found 32772"),
        ("a = '\ud800'", r"settings: expected UTF-8 text, found '\\ud800'"),
        ("a = 1\na = 2", "settings: expected TOML: Cannot overwrite a value"),
        ("a = " + "9" * 5_000, "settings: expected TOML, found an integer of too many digits"),
    ],
)
def test_other_texts_are_one_clear_line(text: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message) as caught:
        parse_toml(text, "settings", error=ConfigError)
    assert "\n" not in str(caught.value)


@given(st.lists(st.sampled_from(["'", '"', '"""', "'''", "\\", "[", "]", "{", "}", ".", "a", " = ", "\n", "#", ", "])))
def test_whatever_is_accepted_is_what_the_text_says(parts: list[str]) -> None:
    text = "".join(parts)
    try:
        found = parse_toml(text, "settings", error=ConfigError)
    except ConfigError:
        return
    assert found == tomllib.loads(text)
    assert depth(found) <= MAX_DEPTH


def depth(value: object) -> int:
    inner = value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
    return 1 + max(map(depth, inner), default=-1)


@pytest.mark.parametrize("robot", ["asimo", "icub", "g1", "talos"])
def test_the_robots_that_come_with_the_program_are_read(robot: str) -> None:
    text = data_path("robots", robot, "robot.toml").read_text()
    assert parse_toml(text, "robot", error=ConfigError) == tomllib.loads(text)
