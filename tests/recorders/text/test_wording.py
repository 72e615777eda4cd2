"""Values in error lines read as in the file that they come from, whatever they are called in Python."""

import datetime
import json

import pytest

from recorders.text.wording import json_fault_text, line_text, names_text, value_text


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
        (datetime.date(1979, 5, 27), "1979-05-27"),
        (datetime.datetime(1979, 5, 27, 7, 32, tzinfo=datetime.UTC), "1979-05-27T07:32:00+00:00"),
        (datetime.time(7, 32), "07:32:00"),
        ("x" * 100, "'" + "x" * 78 + "…"),
    ],
)
def test_a_value_is_shown_without_pythons_words(value: object, text: str) -> None:
    assert value_text(value) == text


@pytest.mark.parametrize(
    ("data", "text"),
    [
        (b"{", "Expecting property name enclosed in double quotes: line 1 column 2 (char 1)"),
        (b"[" * 100_000, "nested too deeply"),
        (b"9" * 5000, "found a whole number of too many digits"),
        (b"\xff\xfe\xff", "found bytes that are no UTF-8"),
    ],
)
def test_what_is_no_json_is_told_without_pythons_words(data: bytes, text: str) -> None:
    with pytest.raises((ValueError, RecursionError)) as raised:
        json.loads(data.decode())
    assert json_fault_text(raised.value) == text


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
