"""Values in error lines read as in the file that they come from, whatever they are called in Python."""

import pytest

from recorders.wording import value_text


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
