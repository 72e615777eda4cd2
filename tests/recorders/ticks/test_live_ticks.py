"""Ticks of what anyone publishes: what is refused, what is given up, and which gaps are seen."""

from collections.abc import Iterable
from typing import Any

import numpy as np
import pytest

from recorders.cdr.codec import encode
from recorders.errors import JointError, MessageError, OutOfRange
from recorders.messages.message_types import JointState, PoseStamped, String
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import COMMANDED_TICK, hand_measured
from recorders.ticks import live
from recorders.ticks.live import LiveTick, LiveTicks
from recorders.ticks.stamp_joiner import RejectionError

LEFT, RIGHT, JOINTS = range(3)
SECOND = 10**9
MEASURED_TICK = (hand_measured("left"), hand_measured("right"), COMMANDED_TICK[JOINTS])


def record(rank: int, stamp: int, number: int = 0, *, topics: tuple[str, ...] = COMMANDED_TICK) -> RecordedMessage:
    """Return a message of a tick."""
    message: Any = JointState(stamp, ("a",), np.ones(1)) if rank == JOINTS else PoseStamped(stamp, np.ones(3))
    return RecordedMessage(topics[rank], message.TYPE, encode(message), number, stamp)


def unreadable(stamp: int) -> RecordedMessage:
    """Return a target that is none, whose stamp can be read."""
    message = PoseStamped(stamp, np.full(3, np.nan))
    return record(LEFT, stamp)._replace(data=encode(message))


def feed(ticks: LiveTicks, stamp: int, numbers: Iterable[int] = (0, 0, 0), *, numbered: bool = False) -> LiveTick:
    """Feed a whole tick and return it."""
    found = [ticks.feed(record(rank, stamp, number), numbered=numbered) for rank, number in enumerate(numbers)]
    assert found[:2] == [None, None]
    assert found[2] is not None
    return found[2]


def reject(ticks: LiveTicks, message: RecordedMessage) -> tuple[str, str]:
    """Feed a message that is of no use; return the kind and the line."""
    with pytest.raises(RejectionError) as rejection:
        ticks.feed(message, numbered=False)
    return rejection.value.kind, str(rejection.value)


def numbers_say(*numbers: Iterable[int]) -> list[bool]:
    """Return after which ticks, by the numbers of their messages, one is missing before."""
    ticks = LiveTicks()
    return [feed(ticks, stamp, of_tick, numbered=True).after_gap for stamp, of_tick in enumerate(numbers)]


def test_a_tick_is_its_messages_in_the_order_of_the_topics() -> None:
    ticks = LiveTicks()
    for rank in (JOINTS, RIGHT):
        assert ticks.feed(record(rank, 5), numbered=False) is None
    whole = tuple(record(rank, 5) for rank in range(3))
    assert ticks.feed(record(LEFT, 5), numbered=False) == LiveTick(5, whole, after_gap=False)


def test_a_tick_at_the_very_beginning_of_time_is_one() -> None:
    assert feed(LiveTicks(), 0).stamp_ns == 0


def test_time_is_that_of_the_last_complete_tick() -> None:
    ticks = LiveTicks()
    feed(ticks, 5)
    for stamp in (4, 5):
        kind, line = reject(ticks, record(LEFT, stamp, 3))
        assert kind == "not after the last tick"
        assert line.startswith(f"/hand/left/target #3: stamp {stamp} ns is not after the tick at 5 ns")
    assert feed(ticks, 6).stamp_ns == 6


def test_a_new_cycle_begins_time_anew_and_counts_what_waits() -> None:
    ticks = LiveTicks()
    feed(ticks, 5, (7, 7, 7), numbered=True)
    ticks.feed(record(LEFT, 8), numbered=False)
    ticks.feed(record(LEFT, 9), numbered=False)
    ticks.begin()
    assert ticks.dropped == 2
    tick = feed(ticks, 1, (70, 70, 70), numbered=True)
    assert (tick.stamp_ns, tick.after_gap) == (1, False)
    assert ticks.feed(record(RIGHT, 8), numbered=False) is None
    assert ticks.feed(record(JOINTS, 8), numbered=False) is None  # the left hand's went with the cycle


def test_what_was_refused_before_a_new_cycle_is_no_gap_of_it() -> None:
    ticks = LiveTicks()
    feed(ticks, 1)
    reject(ticks, unreadable(8))
    ticks.feed(record(LEFT, 6), numbered=False)
    ticks.begin()
    feed(ticks, 1)
    ticks.feed(record(JOINTS, 8), numbered=False)
    assert not feed(ticks, 9).after_gap


def far_behind(ticks: LiveTicks, rank: int, stamps: Iterable[int]) -> None:
    """Feed messages of one topic that are before the last tick."""
    for stamp in stamps:
        assert reject(ticks, record(rank, stamp))[0] == "not after the last tick"


def test_a_clock_that_begins_anew_is_followed_once_ten_messages_of_every_topic_go_on_there() -> None:
    ticks = LiveTicks()
    feed(ticks, 100 * SECOND)
    far_behind(ticks, LEFT, range(15))
    far_behind(ticks, RIGHT, range(10))
    far_behind(ticks, JOINTS, range(9))
    assert ticks.restarts == 0
    far_behind(ticks, JOINTS, [9])
    assert ticks.restarts == 1
    assert [feed(ticks, stamp).after_gap for stamp in (20, 21)] == [True, False]
    ticks.begin()
    assert not feed(ticks, 1).after_gap
    assert ticks.restarts == 1


def test_ticks_that_wait_are_given_up_where_the_clock_begins_anew() -> None:
    ticks = LiveTicks()
    feed(ticks, 100 * SECOND)
    ticks.feed(record(LEFT, 100 * SECOND + 1), numbered=False)
    for rank in range(3):
        far_behind(ticks, rank, range(10))
    assert (ticks.restarts, ticks.dropped) == (1, 1)


def test_a_stamp_that_is_repeated_begins_the_row_of_its_topic_again() -> None:
    ticks = LiveTicks()
    feed(ticks, 100 * SECOND)
    for rank in (LEFT, RIGHT):
        far_behind(ticks, rank, range(10))
    far_behind(ticks, JOINTS, [*range(9), 8, *range(9, 17)])
    assert ticks.restarts == 0
    far_behind(ticks, JOINTS, [17])
    assert ticks.restarts == 1


def test_what_is_late_by_ten_seconds_at_most_begins_no_clock() -> None:
    ticks = LiveTicks()
    feed(ticks, 100 * SECOND)
    for rank in range(3):
        far_behind(ticks, rank, range(90 * SECOND - 9, 90 * SECOND + 9))
    assert ticks.restarts == 0
    for rank in range(3):
        far_behind(ticks, rank, range(90 * SECOND - 10, 90 * SECOND))
    assert ticks.restarts == 1


def test_a_tick_between_messages_far_behind_begins_their_count_again() -> None:
    ticks = LiveTicks()
    feed(ticks, 100 * SECOND)
    for start in (0, 9):
        for rank in range(3):
            far_behind(ticks, rank, range(start, start + 9))
        feed(ticks, 100 * SECOND + 1 + start)
    assert ticks.restarts == 0


@pytest.mark.parametrize("rank", [LEFT, RIGHT])
def test_a_tick_that_lacks_a_message_is_dropped_and_leaves_a_gap(rank: int) -> None:
    ticks = LiveTicks()
    assert not feed(ticks, 1).after_gap
    ticks.feed(record(rank, 2), numbered=False)
    assert ticks.dropped == 0
    assert feed(ticks, 3).after_gap
    assert ticks.dropped == 1
    assert not feed(ticks, 4).after_gap


def test_before_the_first_tick_there_is_no_gap() -> None:
    ticks = LiveTicks()
    ticks.feed(record(LEFT, 1), numbered=False)
    assert not feed(ticks, 2).after_gap


def test_joints_alone_are_counted_and_leave_no_gap() -> None:
    ticks = LiveTicks()
    feed(ticks, 1)
    ticks.feed(record(JOINTS, 2), numbered=False)
    assert not feed(ticks, 3).after_gap
    assert ticks.dropped == 1


def test_hands_as_measured_alone_are_neither_counted_nor_a_gap() -> None:
    ticks = LiveTicks(topics=MEASURED_TICK)

    def whole(stamp: int) -> LiveTick | None:
        return [ticks.feed(record(rank, stamp, topics=MEASURED_TICK), numbered=False) for rank in range(3)][-1]

    whole(1)
    ticks.feed(record(LEFT, 2, topics=MEASURED_TICK), numbered=False)
    tick = whole(3)
    assert tick is not None
    assert not tick.after_gap
    assert ticks.dropped == 0
    ticks.feed(record(LEFT, 4, topics=MEASURED_TICK), numbered=False)
    ticks.begin()
    assert ticks.dropped == 0
    whole(1)
    ticks.feed(record(JOINTS, 2, topics=MEASURED_TICK), numbered=False)
    tick = whole(3)
    assert tick is not None
    assert tick.after_gap
    assert ticks.dropped == 1


def test_joints_whose_target_was_refused_are_a_gap() -> None:
    ticks = LiveTicks()
    feed(ticks, 1)
    reject(ticks, unreadable(2))
    ticks.feed(record(JOINTS, 2), numbered=False)
    assert feed(ticks, 3).after_gap
    assert not feed(ticks, 4).after_gap


def test_joints_that_were_refused_are_none() -> None:
    ticks = LiveTicks()
    feed(ticks, 1)
    wrong = record(JOINTS, 2)
    reject(ticks, wrong._replace(data=wrong.data[:-8]))
    ticks.feed(record(JOINTS, 2), numbered=False)
    assert not feed(ticks, 3).after_gap


def test_a_target_refused_at_a_past_stamp_is_no_gap_to_come() -> None:
    ticks = LiveTicks()
    feed(ticks, 5)
    for stamp in (4, 5):
        reject(ticks, unreadable(stamp))
    assert ticks._refused_at == {}


def test_no_more_refused_stamps_are_kept_than_ticks_may_wait_and_the_latest_are() -> None:
    ticks = LiveTicks()
    for stamp in range(1, live.MAX_PENDING + 3):
        reject(ticks, unreadable(stamp))
    assert list(ticks._refused_at) == list(range(3, live.MAX_PENDING + 3))
    feed(ticks, 20)
    assert list(ticks._refused_at) == list(range(21, live.MAX_PENDING + 3))


def test_no_more_ticks_wait_than_may() -> None:
    ticks = LiveTicks()
    for stamp in range(live.MAX_PENDING):
        ticks.feed(record(LEFT, stamp), numbered=False)
    assert ticks.dropped == 0
    ticks.feed(record(LEFT, 1000), numbered=False)
    assert ticks.dropped == 1


def test_a_message_of_the_largest_size_is_read_and_one_larger_is_not() -> None:
    names = ("x" * 1000,) * 64
    size = len(encode(JointState(1, (*names, ""), np.empty(0))))
    fitting = JointState(1, (*names, "y" * (live.MAX_MESSAGE - size)), np.empty(0))
    message = RecordedMessage(COMMANDED_TICK[JOINTS], fitting.TYPE, encode(fitting), 4, 1)
    while len(message.data) > live.MAX_MESSAGE:
        fitting = JointState(1, (*names, fitting.name[-1][:-1]), np.empty(0))
        message = message._replace(data=encode(fitting))
    message = message._replace(data=message.data + bytes(live.MAX_MESSAGE - len(message.data)))
    assert LiveTicks().feed(message, numbered=False) is None
    kind, line = reject(LiveTicks(), message._replace(data=message.data + b"\0"))
    assert (kind, line) == ("too large", "/sample/joint_states #4: 65537 bytes, expected at most 65536")


def test_the_reason_of_a_rejection_is_the_readers_or_the_checks() -> None:
    def check_raises(error: Exception) -> LiveTicks:
        def check(_: object) -> None:
            raise error

        return LiveTicks(check)

    def read(_: PoseStamped) -> Any:
        raise OutOfRange("turned too far", finite=True)

    wrong = RecordedMessage(COMMANDED_TICK[LEFT], String.TYPE, encode(String("x")), 2, 0)
    assert reject(LiveTicks(), wrong)[0] == "unreadable"
    line = "/hand/left/target #2: "
    assert reject(check_raises(JointError("no such joint")), record(LEFT, 1, 2)) == (
        "wrong joints",
        f"{line}no such joint",
    )
    assert reject(check_raises(MessageError("too far")), record(LEFT, 1, 2)) == ("implausible", f"{line}too far")
    posed = LiveTicks(poses={COMMANDED_TICK[LEFT]: read})
    assert reject(posed, record(LEFT, 1, 2)) == ("implausible", f"{line}turned too far")


def test_a_refused_message_changes_nothing() -> None:
    ticks = LiveTicks()
    ticks.feed(record(LEFT, 3), numbered=False)
    reject(ticks, record(LEFT, 3, 9))
    reject(ticks, record(RIGHT, 3)._replace(data=b""))
    ticks.feed(record(RIGHT, 3), numbered=False)
    tick = ticks.feed(record(JOINTS, 3), numbered=False)
    assert tick is not None
    assert tick.records == tuple(record(rank, 3) for rank in range(3))


@pytest.mark.parametrize(
    ("numbers", "gaps"),
    [
        # Each topic counts for itself: a step of two on all of them is a tick that never came.
        ([(0, 0, 0), (1, 1, 1), (3, 3, 3), (4, 4, 4)], [False, False, True, False]),
        ([(0, 10, 20), (2, 12, 22)], [False, True]),
        # One topic went on, so that the tick was there.
        ([(0, 0, 0), (1, 2, 2)], [False, False]),
        ([(0, 0, 0), (2, 2, 1)], [False, False]),
        # One counter over all topics, or over two: it jumps between any two ticks.
        ([(0, 1, 2), (3, 4, 5), (6, 7, 8)], [False, False, False]),
        ([(10, 11, 500), (20, 21, 502)], [False, False]),
        ([(500, 10, 11), (502, 20, 21)], [False, False]),
        # A publisher that began anew says nothing; afterwards its numbers count again.
        ([(5, 5, 5), (0, 7, 7), (2, 9, 9)], [False, False, True]),
        ([(5, 5, 5), (5, 7, 7)], [False, False]),
        # Two that one tick brought too near for one counter are two, whatever comes later.
        ([(0, 2, 100), (1, 4, 101), (10, 11, 110), (20, 21, 120)], [False, False, True, True]),
        ([(0, 1, 100), (1, 4, 101), (10, 11, 110), (20, 21, 120)], [False, False, True, True]),
        # Four numbers in a row, two by two, can be one counter; less than that cannot.
        ([(0, 1, 100), (2, 3, 102)], [False, False]),
        ([(0, 1, 100), (2, 3, 102), (20, 21, 104), (40, 41, 106)], [False, False, False, False]),
    ],
)
def test_numbers_tell_a_tick_that_never_came(numbers: list[tuple[int, int, int]], gaps: list[bool]) -> None:
    assert numbers_say(*numbers) == gaps


def test_numbers_of_a_recorder_say_nothing() -> None:
    ticks = LiveTicks()
    assert not feed(ticks, 1, (0, 0, 0)).after_gap
    assert not feed(ticks, 2, (5, 5, 5)).after_gap
