"""Numbers on a topic: what is missing is counted of each publisher by itself, whatever others publish between."""

import pytest

from recorders.recording import last_numbers
from recorders.recording.last_numbers import LastNumbers


def missing(numbers: str) -> list[int]:
    """Return what is missing before each message; `a3` is number 3 of publisher `a`."""
    last = LastNumbers()
    return [last.missing_before("/learner/output", text[:1].encode(), int(text[1:])) for text in numbers.split()]


@pytest.mark.parametrize(
    ("numbers", "expected"),
    [
        ("a0 a1 a2 a3", [0, 0, 0, 0]),
        ("a7 a8 a11 a12", [0, 0, 2, 0]),
        ("a0 a5 a3 a6 a0 a1 a3", [0, 4, 0, 0, 0, 0, 1]),  # one that is late is no second gap; 0 begins anew
        ("a0 a1 a2 b0 a3 b1 b2 a4", [0] * 8),
        ("a0 b0 b3 a1 b4 a4", [0, 0, 2, 0, 0, 2]),
    ],
)
def test_each_publisher_has_numbers_of_its_own(numbers: str, expected: list[int]) -> None:
    assert missing(numbers) == expected


def test_topics_have_numbers_of_their_own() -> None:
    last = LastNumbers()
    assert [last.missing_before(topic, b"a", number) for topic, number in (("/x", 0), ("/y", 5), ("/x", 1))] == [0] * 3


def test_who_was_silent_for_longest_is_forgotten_first(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(last_numbers, "_MOST_KNOWN", 2)
    assert missing("a0 b0 a1 c0 a5 c3 b9") == [0, 0, 0, 0, 3, 2, 0]
