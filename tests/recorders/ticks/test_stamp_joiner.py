"""The joiner of stamps alone: what waits, what is given up and when, for any topics."""

import itertools
import random

import pytest

from recorders.messages.record import RecordedMessage
from recorders.ticks.stamp_joiner import RejectionError, StampJoiner

TOPICS = ("/a", "/b")


def record(rank: int, stamp: int) -> RecordedMessage:
    return RecordedMessage(TOPICS[rank], "", b"", stamp, 0)


def joiner(limit: int = 3) -> tuple[StampJoiner[int], list[tuple[int, list[str], str]]]:
    given_up: list[tuple[int, list[str], str]] = []
    joined: StampJoiner[int] = StampJoiner(
        TOPICS, limit=limit, give_up=lambda stamp, tick, why: given_up.append((stamp, joined.absent(tick), why))
    )
    return joined, given_up


def test_messages_are_joined_in_the_order_of_the_topics_whatever_the_order_of_arrival() -> None:
    for order in itertools.permutations([(rank, stamp) for rank in (0, 1) for stamp in (1, 2)]):
        joined, given_up = joiner()
        complete = 0
        for rank, stamp in order:
            parts = joined.add(stamp, rank, record(rank, stamp), 10 * stamp + rank)
            if parts is not None:
                complete += 1
                assert parts == [(record(0, stamp), 10 * stamp), (record(1, stamp), 10 * stamp + 1)]
        assert complete + len(given_up) == 2


def test_a_tick_that_a_later_one_overtakes_is_given_up() -> None:
    joined, given_up = joiner(limit=4)
    for stamp, rank in ((5, 0), (9, 1), (7, 1), (8, 0), (8, 1)):
        joined.add(stamp, rank, record(rank, stamp), 0)
    assert given_up == [(5, ["/b"], "the tick at 8 ns is complete"), (7, ["/a"], "the tick at 8 ns is complete")]
    assert len(joined.open) == 1
    assert joined.waiting()[0][0] == 9


def test_the_first_that_came_makes_room_and_no_more_wait_than_may() -> None:
    joined, given_up = joiner()
    draw = random.Random(1)
    for stamp in draw.sample(range(1000), 100):
        joined.add(stamp, 0, record(0, stamp), 0)
        assert len(joined.open) <= 3
    draw = random.Random(1)
    came = draw.sample(range(1000), 100)
    assert [stamp for stamp, *_ in given_up] == came[:-3]
    assert given_up[0][2] == f"/a #{came[3]} is 3 ticks ahead of it"


def test_a_second_message_is_rejected_and_changes_nothing() -> None:
    joined, _ = joiner()
    joined.add(4, 0, record(0, 4), 1)
    with pytest.raises(RejectionError, match="/a #4: a second message at 4 ns") as rejection:
        joined.add(4, 0, record(0, 4), 2)
    assert rejection.value.kind == "repeated"
    parts = joined.add(4, 1, record(1, 4), 3)
    assert parts is not None
    assert [value for _, value in parts] == [1, 3]


def test_a_tick_waits_on_if_giving_it_up_raises() -> None:
    def refuse(stamp: int, *_: object) -> None:
        raise ValueError(stamp)

    joined: StampJoiner[int] = StampJoiner(TOPICS, limit=1, give_up=refuse)
    joined.add(1, 0, record(0, 1), 0)
    with pytest.raises(ValueError, match="1"):
        joined.add(2, 0, record(0, 2), 0)
    assert len(joined.open) == 1
    assert joined.add(1, 1, record(1, 1), 0) is not None


def test_what_waits_is_in_the_order_of_the_stamps() -> None:
    joined, _ = joiner()
    for stamp in (5, 3, 4):
        joined.add(stamp, 0, RecordedMessage("/a", "", b"", 9 - stamp, 0), 0)
    assert [stamp for stamp, _ in joined.waiting()] == [3, 4, 5]


def test_a_rejection_is_its_line_and_its_kind() -> None:
    rejection = RejectionError("repeated", "/a #4: again")
    assert (str(rejection), rejection.kind) == ("/a #4: again", "repeated")
