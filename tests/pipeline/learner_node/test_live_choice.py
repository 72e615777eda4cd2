"""A live learner takes ticks with hands if such come, ticks of joints alone if none do, and loses none by waiting."""

import pytest
from episodes import write_plain_episode

from pipeline.learner_node.live_choice import LiveChoice
from recorders.cdr.codec import encode
from recorders.messages.phase import LEARN, Phase
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import SAMPLE_JOINTS, SESSION_PHASE, commanded_tick, is_measured, reached_tick
from recorders.reading.reader import LogReader
from recorders.ticks.live import WAIT_TICKS
from replay.sources.live import LiveStream

TICKS = WAIT_TICKS + 4
REACHED, JOINTS = reached_tick(("left", "right")), (SAMPLE_JOINTS,)


@pytest.fixture(scope="module")
def records(tmp_path_factory: pytest.TempPathFactory) -> list[RecordedMessage]:
    log = write_plain_episode(tmp_path_factory.mktemp("choice") / "log.mcap", samples=TICKS - 1, measured=True)
    return list(LogReader(log))


def without_hands(records: list[RecordedMessage]) -> list[RecordedMessage]:
    return [record for record in records if not is_measured(record.topic)]


def choice() -> LiveChoice:
    return LiveChoice(lambda tick: LiveStream(tick=tick), REACHED, JOINTS)


def expected(records: list[RecordedMessage], tick: tuple[str, ...]) -> list[RecordedMessage]:
    stream = LiveStream(tick=tick)
    return [found for record in records for found in stream.feed(record)]


def marker(cycle: int) -> RecordedMessage:
    message = Phase("ab" * 16, 0, cycle, LEARN, log="").to_message()
    return RecordedMessage(SESSION_PHASE, message.TYPE, encode(message), cycle, 0)


def test_where_hands_come_their_ticks_are_taken(records: list[RecordedMessage]) -> None:
    live = choice()
    found = [out for record in (marker(0), *records) for out in live.feed(record)]
    assert found == expected([marker(0), *records], REACHED)
    assert (live.tick, live.ticks) == (REACHED, TICKS)


def test_where_none_come_joints_are_taken_and_none_is_lost(records: list[RecordedMessage]) -> None:
    live, bare = choice(), without_hands(records)
    at_once = [live.feed(record) for record in bare]
    assert [out for outs in at_once for out in outs] == expected(bare, JOINTS)
    assert sum(map(bool, at_once)) == TICKS - WAIT_TICKS + 1
    assert (live.tick, live.ticks) == (JOINTS, TICKS)
    assert [out for record in records for out in live.feed(record) if is_measured(out.topic)] == []  # it is settled


def test_a_short_session_without_hands_is_taken_at_its_end(records: list[RecordedMessage]) -> None:
    live, bare = choice(), without_hands(records)[: 3 * (WAIT_TICKS - 1)]
    assert [out for record in bare for out in live.feed(record)] == []
    assert 0 < live.ticks < WAIT_TICKS
    assert list(live.settle()) == expected(bare, JOINTS)
    assert live.tick == JOINTS


@pytest.mark.parametrize(
    ("topics", "tick"), [(commanded_tick(("left", "right")), JOINTS), (REACHED, REACHED), (None, REACHED)]
)
def test_a_stream_that_names_its_topics_decides(
    records: list[RecordedMessage], topics: tuple[str, ...] | None, tick: tuple[str, ...]
) -> None:
    live = choice()
    assert live.settle(topics) == ()
    assert live.tick == tick
    assert [out for record in records for out in live.feed(record)] == expected(records, tick)


def test_markers_without_ticks_do_not_fill_the_memory() -> None:
    live = choice()
    found = [live.feed(marker(cycle)) for cycle in range(5000)]
    assert [len(outs) for outs in found if outs] == [4096] + [1] * (5000 - 4096)
    assert live.tick == REACHED
