"""Values in error lines read as in the file that they come from, whatever they are called in Python."""

import pytest

from recorders.wording import line_text, names_text, value_text


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, "nothing"),
        (True, "true"),
        ("a b", "'a b'"),
        (1.5, "1.5"),
        (b"PK\x03\xff", r"'PK\x03\xff'"),
        ({"a": {}}, "a table of 1"),
        (["a", "b"], "a list of 2"),
        ("x" * 100, "'" + "x" * 78 + "…"),
    ],
)
def test_a_value_is_shown_without_pythons_words(value: object, text: str) -> None:
    assert value_text(value) == text


def test_a_number_of_thousands_of_digits_is_not_written_out() -> None:
    assert value_text(10**5000) == "a whole number, a huge one"


@pytest.mark.parametrize(
    ("names", "end"),
    [
        ([f"/topic/{index}" for index in range(65_535)], " more"),
        (["a" * 1_000_000, "b"], "…, b"),
        (["a" * 400, "b" * 400], " and 1 more"),
        (["a", "b"], "a, b"),
        ([], ""),
    ],
)
def test_a_list_of_names_has_an_end_and_tells_how_many_more_there_are(names: list[str], end: str) -> None:
    text = names_text(names)
    assert len(text) < 700
    assert text.endswith(end)


def test_a_line_has_an_end_and_keeps_what_is_to_be_done() -> None:
    line = line_text(f"/log: expected\nthis, found {'x' * 100_000}; give foreign names with --map")
    assert len(line) < 3100
    assert line.startswith("/log: expected this, found xxx")
    assert line.endswith("give foreign names with --map")
    assert line_text("as it is") == "as it is"
