"""The queue between the network's threads and the one that takes: what waits, and for how long."""

import math
import threading
import time

import pytest

from recorders.wire.bounded_queue import BoundedQueue


@pytest.mark.parametrize("wait_s", [0.0, 0.2, 0.7])
def test_nothing_is_told_when_the_time_is_over(wait_s: float) -> None:
    began_s = time.monotonic()
    assert BoundedQueue[str](limit=1).get(wait_s) is None
    assert time.monotonic() - began_s >= wait_s


@pytest.mark.parametrize("wait_s", [math.inf, 60.0])
def test_what_comes_late_is_told_at_once(wait_s: float) -> None:
    inbox = BoundedQueue[str](limit=1)
    threading.Timer(0.8, inbox.put, ("late", 4)).start()
    assert inbox.get(wait_s) == "late"


def test_all_comes_out_in_order_and_makes_room() -> None:
    inbox = BoundedQueue[int](limit=10_000)
    while inbox.put(0, 1_000):
        pass
    assert inbox.get(0.0) == 0
    assert inbox.put(1, 1_000)
    taken = []
    while (item := inbox.get(0.0)) is not None:
        taken.append(item)
    assert taken[-1] == 1
    assert set(taken[:-1]) == {0}


def test_a_single_item_has_room_however_large() -> None:
    inbox = BoundedQueue[str](limit=10)
    assert inbox.put("large", 1_000_000)
    assert not inbox.put("more", 1)
    assert inbox.get(0.0) == "large"
    assert inbox.get(0.0) is None


def test_what_waits_counts_for_more_than_its_payload() -> None:
    inbox = BoundedQueue[str](limit=5_000)
    assert [inbox.put(name, 0) for name in "abcdef"] == [True] * 4 + [False] * 2
    assert [inbox.get(0.0) for _ in range(5)] == ["a", "b", "c", "d", None]


def test_a_time_that_is_over_at_once_ends_the_wait() -> None:
    inbox = BoundedQueue[int](limit=10_000)
    for number in range(2_000):  # a `queue.SimpleQueue` in its place hangs within some tens
        assert inbox.put(number, 4)
        assert inbox.get(1e-6) == number
        assert inbox.get(1e-6) is None


def test_a_taker_misses_nothing_that_is_put_while_it_begins_to_wait() -> None:
    inbox, count = BoundedQueue[int](limit=10**9), 20_000
    putting = threading.Thread(target=lambda: [inbox.put(number, 0) for number in range(count)])
    putting.start()
    taken: list[int] = []
    while len(taken) < count:
        item = inbox.get(60.0)
        assert item is not None
        taken.append(item)
    putting.join()
    assert taken == list(range(count))
