"""Stamps lie where a plain version that goes message by message has them, in whatever blocks they come."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from plain_stamp_order import PlainStampOrder

from pipeline.alignment.clock import Place, StampOrder

SECOND = 10**9
START = 1_700_000_000 * SECOND
EDGES = (10 * SECOND, 60 * SECOND)

Part = tuple[tuple[int, ...], int, int, int]
"""Topics in turn, how far the first stamp is from the latest of all [ns], the step [ns], and how many."""

FAR = st.sampled_from(
    [0, 1, -1, 10**6, 5 * SECOND, *(sign * edge + more for edge in EDGES for sign in (1, -1) for more in (-1, 0, 1))]
)
PARTS = st.lists(
    st.tuples(
        st.sampled_from([(0,), (1,), (0, 1), (1, 0), (0, 0, 1)]),
        FAR | st.sampled_from([-100 * SECOND, 3600 * SECOND, -(10**6) * SECOND]),
        st.sampled_from([1, 10**7, 0, -1, 61 * SECOND]),
        st.integers(1, 24),
    ),
    max_size=8,
)


def messages_of(parts: list[Part]) -> list[tuple[int, int]]:
    found, latest = [], START
    for topics, away, step, count in parts:
        first = latest + away
        for index in range(count):
            stamp = first + step * index
            found.append((topics[index % len(topics)], stamp))
            latest = max(latest, stamp) if abs(away) < 10**5 * SECOND else stamp
    return found


def placed(messages: list[tuple[int, int]], block: int, *, topics: int = 2) -> list[str]:
    """Where an order in blocks has them; a block is cut where the clock begins anew, as the aligner cuts it."""
    order, found = StampOrder(topics), list[str]()
    for start in range(0, len(messages), block):
        rest, anew = messages[start : start + block], False
        while rest:
            ranks, stamps = (np.array(values, np.int64) for values in zip(*rest, strict=True))
            places, restart = order.check(ranks, stamps)
            part = len(rest) if restart is None else restart
            if restart is not None:
                places, none = order.check(ranks[:part], stamps[:part])
                assert none is None
            names = [Place(place).name.lower() for place in places[:part].tolist()]
            found += ["anew", *names[1:]] if anew and names else names
            rest, anew = rest[part:], restart is not None
            if anew:
                order.begin()
    return found


@settings(max_examples=80)
@given(PARTS, st.sampled_from([1, 2, 5, 1000]))
@example([((0,), 0, 1, 1), ((1,), 60 * SECOND + 1, 1, 4)], 3)
@example([((0, 1), 0, 1, 4), ((0, 1), -100 * SECOND, 1, 24)], 1000)
@example([((0, 1), 0, 1, 4), ((0,), 60 * SECOND + 1, 1, 2), ((1,), 0, 1, 2), ((0,), 60 * SECOND + 1, 1, 4)], 2)
def test_stamps_lie_where_the_plain_version_has_them(parts: list[Part], block: int) -> None:
    messages, plain = messages_of(parts), PlainStampOrder(2)
    assert placed(messages, block) == [plain.take(rank, stamp) for rank, stamp in messages]


def pairs(first_s: float, *steps: int) -> list[tuple[int, int]]:
    """Return stamps of both topics from a time on [s], at some steps [ns]."""
    return [(rank, START + int(first_s * SECOND) + step) for step in steps for rank in (0, 1)]


@pytest.mark.parametrize("block", [1, 2, 3, 4, 5, 1000])
@pytest.mark.parametrize(
    "messages",
    [
        [*pairs(0, 0), (0, START + 9), (0, START + 9), (1, START + 9)],  # a repetition
        [*pairs(0, 0, 1), (0, START + 5), (0, START + 9), (0, START + 7), (1, START + 9)],  # one is late
        [*pairs(0, 0), *pairs(-20, *range(9)), *pairs(1, 0), *pairs(-20, *range(9, 12))],  # nine behind, and once more
        [*pairs(0, 0), *pairs(-20, *range(5)), *pairs(-20, 9, *range(5)), *pairs(-20, *range(5, 12))],  # not in a row
        [
            (0, START),
            (1, START - 8 * SECOND),
            *pairs(5, 0)[:1],
            *pairs(-6, *range(14))[1:],
        ],  # behind what was just before
        [
            (0, START),
            *pairs(-30, *range(9)),
            (1, START - 10 * SECOND),
            *pairs(-30, 9, 10),
        ],  # ten seconds are not behind
        [(0, START), *((1, START + 61 * SECOND + step) for step in (0, 0, 1, 1, 2, 3))],  # leaps that do not rise
        [*pairs(0, 0), *pairs(61, 0), *pairs(1, 0), *pairs(61, 0, 1, 2, 3)],  # leaps between others
    ],
)
def test_odd_stamps_lie_where_the_plain_version_has_them(messages: list[tuple[int, int]], block: int) -> None:
    plain = PlainStampOrder(2)
    assert placed(messages, block) == [plain.take(rank, stamp) for rank, stamp in messages]


def test_stamps_that_go_on_steadily_are_noted_together(monkeypatch: pytest.MonkeyPatch) -> None:
    """One by one, a recording takes many times as long."""
    order, ranks = StampOrder(2), np.array([0, 1] * 50)
    order.check(ranks[:2], np.array([START, START]))
    monkeypatch.delattr(StampOrder, "_note")
    for turn in range(3):
        stamps = START + 10**9 * turn + 10**7 * np.repeat(np.arange(1, 51), 2)
        places, restart = order.check(ranks, stamps)
        assert (places.tolist(), restart) == ([Place.NEXT] * 100, None)
    assert order.check(ranks[:0], stamps[:0]).restart is None


@pytest.mark.parametrize("block", [1, 1000])
@pytest.mark.parametrize(
    ("away", "count", "expected"),
    [
        (10 * SECOND, 3, ["next"] * 3),
        (60 * SECOND, 1, ["next"]),
        (60 * SECOND + 1, 3, ["ahead", "ahead", "next"]),
        (-10 * SECOND - 9, 10, ["late"] * 10),
        (-10 * SECOND - 10, 12, ["late"] * 9 + ["anew", "next", "next"]),
    ],
)
def test_leaps_and_new_beginnings_have_their_ends(away: int, count: int, expected: list[str], block: int) -> None:
    """Of one topic: 60 s ahead is no leap yet, 10 s behind nothing new; the third and the tenth message count."""
    messages, plain = [(0, START), *((0, START + away + index) for index in range(count))], PlainStampOrder(1)
    assert placed(messages, block, topics=1) == ["next", *expected]
    assert [plain.take(rank, stamp) for rank, stamp in messages] == ["next", *expected]
