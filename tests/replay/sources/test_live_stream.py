"""What anyone publishes becomes a stream that a learner can take, or is refused; a refused message changes nothing."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from episodes import PERIOD_NS, write_episode
from sessions import write_foreign

from pipeline.learner.rules.reservoir.config import LearnerConfig
from pipeline.robot.config import load_robot
from pipeline.robot.range_check import range_check
from pipeline.training.trainer import Trainer, train_on
from recorders.cdr.codec import decode, encode
from recorders.errors import LogError
from recorders.messages.message_types import JointState, Message, PoseStamped, String
from recorders.messages.phase import EVALUATE, LEARN, WASHOUT, Phase
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import LEFT_TARGET, RIGHT_TARGET, SAMPLE_JOINTS, SESSION_PHASE, TF
from recorders.reading.reader import LogReader
from recorders.ticks.live import MAX_MESSAGE, MAX_PENDING
from recorders.writing.writer import LogWriter
from replay.sources.live import LIVE_RUN, LiveLog, LiveStream, live_offer

ASIMO = load_robot("asimo")
TICKS = 10


@pytest.fixture(scope="module")
def ticks(tmp_path_factory: pytest.TempPathFactory) -> list[list[RecordedMessage]]:
    records = list(LogReader(write_episode(tmp_path_factory.mktemp("live") / "log.mcap", samples=TICKS - 1)))
    return [records[3 * tick : 3 * tick + 3] for tick in range(TICKS)]


def made(
    records: Sequence[RecordedMessage], *, numbered: bool = True, **options: object
) -> tuple[LiveStream, list[RecordedMessage]]:
    live = LiveStream(check=range_check(ASIMO), **options)
    stream = [out for record in records for out in live.feed(record, numbered=numbered)]
    live.finish()
    return live, stream


def flat(ticks: Sequence[Sequence[RecordedMessage]]) -> list[RecordedMessage]:
    return [record for tick in ticks for record in tick]


def marker(*, run: str = "ab" * 16, epoch: int = 0, cycle: int = 0, phase: str = LEARN) -> RecordedMessage:
    data = encode(Phase(run, epoch, cycle, phase, log="").to_message())
    return RecordedMessage(SESSION_PHASE, String.TYPE, data, cycle, 0)


def parsed(record: RecordedMessage) -> Phase:
    message = decode(record.type, record.data)
    assert isinstance(message, String)
    return Phase.from_message(message)


def altered(record: RecordedMessage, **changes: object) -> RecordedMessage:
    message: Message = decode(record.type, record.data)
    return record._replace(data=encode(replace(message, **changes)))


def test_ticks_without_a_marker_are_for_learning(ticks: list[list[RecordedMessage]]) -> None:
    live, (first, *stream) = made(flat(ticks))
    assert stream == flat(ticks)
    assert parsed(first) == Phase(LIVE_RUN, 0, 0, LEARN, log="")
    assert (live.run, live.ticks, live.dropped, live.gaps, live.refused) == (LIVE_RUN, TICKS, 0, 0, {})


def test_topics_may_run_ahead_of_one_another_and_other_topics_are_passed_over(
    ticks: list[list[RecordedMessage]],
) -> None:
    by_topic = [tick[rank] for rank in (2, 0, 1) for tick in ticks] + [ticks[0][0]._replace(topic=TF)]
    assert made(by_topic)[1] == made(flat(ticks))[1]


def test_messages_of_nobodys_numbering_are_numbered_as_a_recorder_does(ticks: list[list[RecordedMessage]]) -> None:
    bare = [record._replace(sequence=0) for record in flat(ticks)]
    assert made(bare, numbered=False)[1] == made(flat(ticks))[1]


def wrong_messages(tick: Sequence[RecordedMessage]) -> list[tuple[RecordedMessage, str]]:
    left, _, joints = tick
    other = JointState(0, ("antenna",), [0.0])
    return [
        (left._replace(data=b"\x00\x01\x02"), "unreadable"),
        (left._replace(data=encode(other)), "unreadable"),
        (left._replace(type=JointState.TYPE, data=encode(other)), "unreadable"),
        (altered(left, position=[np.nan, 0.0, 0.0]), "unreadable"),
        (altered(left, position=[1e9, 0.0, 0.0]), "implausible"),
        (joints._replace(data=encode(other)), "wrong joints"),
        (altered(joints, position=np.full(15, 1e300)), "implausible"),
        (joints._replace(data=bytes(MAX_MESSAGE + 1)), "too large"),
        (altered(left, stamp_ns=0), "not after the last tick"),
        (RecordedMessage(SESSION_PHASE, String.TYPE, encode(String("{")), 0, 0), "marker"),
        (RecordedMessage(SESSION_PHASE, String.TYPE, bytes(5), 0, 0), "marker"),
        (RecordedMessage(SESSION_PHASE, "", b"", 0, 0), "marker"),
        (marker(epoch=1), "marker"),
        (RecordedMessage(SESSION_PHASE, String.TYPE, bytes(MAX_MESSAGE + 1), 0, 0), "too large"),
    ]


def test_what_is_of_no_use_is_refused_and_changes_nothing(
    ticks: list[list[RecordedMessage]], caplog: pytest.LogCaptureFixture
) -> None:
    bad = wrong_messages(ticks[5])
    live, stream = made(flat(ticks[:5]) + [record for record, _ in bad] + flat(ticks[5:]))
    said = list(caplog.messages)
    assert stream == made(flat(ticks))[1]
    assert sorted(live.refused.elements()) == sorted(f"{record.topic}: {kind}" for record, kind in bad)
    assert len(said) == len(live.refused)
    assert all(line.isprintable() and len(line.splitlines()) == 1 for line in said)


def test_a_marker_is_a_text() -> None:
    for kind in ("", PoseStamped.TYPE):
        assert list(made([marker()._replace(type=kind)])[0].refused) == [f"{SESSION_PHASE}: marker"]


def test_a_marker_may_be_as_long_as_any_message(ticks: list[list[RecordedMessage]]) -> None:
    short = marker().data
    for spare, kinds in ((0, []), (1, [f"{SESSION_PHASE}: too large"])):
        text = parsed(marker()).to_message().data + " " * (MAX_MESSAGE - len(short) + spare)
        live, _ = made([marker()._replace(data=encode(String(text))), *flat(ticks)])
        assert list(live.refused) == kinds


def test_losses_are_counted_with_the_first_reason(ticks: list[list[RecordedMessage]]) -> None:
    left, right, joints = ticks[3]
    assert made(flat(ticks))[0].losses == ""
    assert made(flat(ticks[:4] + ticks[6:]))[0].losses == "; gaps 1"
    bad = [left._replace(data=b"\x00\x01\x02"), altered(right, position=[np.nan, 0.0, 0.0]), joints]
    live, _ = made([*flat(ticks[:3]), *bad, *flat(ticks[4:])])
    (first,) = (kind for kind in [live.losses.partition("; the first: ")[2]])
    assert live.losses == f"; refused 2, given up 1, gaps 1; the first: {first}"
    assert first.startswith(f"{LEFT_TARGET} #{left.sequence}: ")


def test_a_gap_is_reported(ticks: list[list[RecordedMessage]], caplog: pytest.LogCaptureFixture) -> None:
    made(flat(ticks[:4] + ticks[6:]))
    stamp = decode(ticks[6][0].type, ticks[6][0].data).stamp_ns
    assert caplog.messages == [f"ticks are missing before the one at {stamp} ns: it is not paired with the one before"]


def test_the_name_of_a_run_that_nobody_named_stays() -> None:
    """It is in recordings of live learning."""
    assert LIVE_RUN == "247610f4dedd4ab7247d07dbda19c81c"


def logged(path: Path, records: Sequence[RecordedMessage]) -> Path:
    with LogWriter(path, manifest={"kind": "test"}) as writer:
        for record in records:
            writer.copy(record)
    return path


def test_what_is_refused_in_a_log_is_reported_once(
    ticks: list[list[RecordedMessage]], tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    log = LiveLog(logged(tmp_path / "log.mcap", [*flat(ticks), ticks[0][0]]))
    assert len(list(log.stream())) == len(list(log.stream())) == 1 + 3 * TICKS
    assert len(caplog.messages) == 1
    assert caplog.messages[0].startswith("refused, ")


def test_times_that_fall_within_ticks_alone_are_no_other_order(
    ticks: list[list[RecordedMessage]], tmp_path: Path
) -> None:
    """A log is refused if it has more steps by log time than by the file."""
    rising = [record._replace(log_time_ns=10 * place + (3 - place) % 3) for place, record in enumerate(flat(ticks))]
    assert LiveLog(write_foreign(tmp_path / "swapped.mcap", rising)).offer().messages == 1 + 3 * TICKS
    falling = [record._replace(log_time_ns=1000 - place) for place, record in enumerate(flat(ticks)[::-1])]
    with pytest.raises(LogError, match=rf"expected the {TICKS - 1} steps that there are by log time, found"):
        LiveLog(write_foreign(tmp_path / "falling.mcap", falling))


def test_a_second_message_of_a_tick_is_refused(ticks: list[list[RecordedMessage]]) -> None:
    left, right, joints = ticks[3]
    forged = altered(left, position=[0.3, 0.2, 0.7])
    live, stream = made([*flat(ticks[:3]), left, forged, right, joints])
    assert stream[-3:] == [left, right, joints]
    assert live.refused == {f"{LEFT_TARGET}: repeated": 1}


def test_it_is_said_ever_more_rarely(ticks: list[list[RecordedMessage]], caplog: pytest.LogCaptureFixture) -> None:
    live, _ = made(flat(ticks) + [ticks[0][0]] * 150)
    assert live.refused.total() == 150
    assert [line.partition(" (")[2] for line in caplog.messages] == ["", "10 times so far)", "100 times so far)"]


@pytest.mark.parametrize(
    "lost", [[1], [0, 2], [0, 1], [0, 1, 2]], ids=["one message", "two", "both targets", "a whole tick"]
)
def test_no_pair_is_made_across_a_missing_tick(ticks: list[list[RecordedMessage]], lost: list[int]) -> None:
    heard = [record for record in flat(ticks) if record not in [ticks[4][rank] for rank in lost]]
    live, stream = made(heard)
    places = [place for place, record in enumerate(stream) if record.topic == SESSION_PHASE]
    assert places == [0, 1 + 3 * 4]
    assert parsed(stream[places[1]]) == parsed(stream[0])
    assert (live.gaps, live.dropped, live.ticks) == (1, len(lost) < 3, TICKS - 1)


def counted_over_all(ticks: Sequence[Sequence[RecordedMessage]], *, others: int = 0) -> list[RecordedMessage]:
    """The messages as a recorder numbers them that counts all topics alike, `others` with every tick."""
    return [
        record._replace(sequence=1000 + (3 + others) * place + rank)
        for place, tick in enumerate(ticks)
        for rank, record in enumerate(tick)
    ]


@pytest.mark.parametrize("others", [0, 1, 97])
def test_one_count_over_all_topics_has_no_gaps(ticks: list[list[RecordedMessage]], others: int) -> None:
    live, stream = made(counted_over_all(ticks, others=others))
    assert (live.gaps, live.steps, len(stream)) == (0, TICKS - 1, 1 + 3 * TICKS)


@pytest.mark.parametrize("first", [(0, 0, 0), (7, 8, 9), (500, 3, 40)], ids=str)
def test_counts_that_began_apart_still_show_a_missing_tick(
    ticks: list[list[RecordedMessage]], first: Sequence[int]
) -> None:
    apart = [
        [record._replace(sequence=record.sequence + start) for record, start in zip(tick, first, strict=True)]
        for tick in ticks
    ]
    assert made(flat(apart[:4] + apart[7:]))[0].gaps == 1


def with_joints_between(ticks: Sequence[Sequence[RecordedMessage]], *, often: int) -> list[RecordedMessage]:
    """The messages of a robot whose joints come so many times as often as its targets, with numbers of their own."""
    heard: list[RecordedMessage] = []
    for place, (left, right, joints) in enumerate(ticks):
        stamps = [place * PERIOD_NS + part * PERIOD_NS // often for part in range(often)]
        same = [altered(joints, stamp_ns=stamp) for stamp in stamps]
        heard += [left, right]
        heard += [record._replace(sequence=place * often + part) for part, record in enumerate(same)]
    return heard


@pytest.mark.parametrize("numbered", [True, False])
def test_joints_more_often_than_targets_are_no_lost_ticks(ticks: list[list[RecordedMessage]], numbered: bool) -> None:
    live, stream = made(with_joints_between(ticks, often=5), numbered=numbered)
    assert (live.gaps, live.ticks, live.steps, live.refused) == (0, TICKS, TICKS - 1, {})
    assert len(stream) == 1 + 3 * TICKS


@pytest.mark.parametrize("position", [[np.nan] * 3, [1e9, 0.0, 0.0]], ids=["no number", "far away"])
def test_a_tick_whose_targets_are_refused_is_a_gap_whoever_numbers_them(
    ticks: list[list[RecordedMessage]], position: list[float]
) -> None:
    bad = [altered(record, position=position) for record in ticks[4][:2]]
    for numbered in (True, False):
        live, _ = made([*flat(ticks[:4]), *bad, *ticks[4][2:], *flat(ticks[5:])], numbered=numbered)
        assert (live.gaps, live.ticks, live.refused.total()) == (1, TICKS - 1, 2)


def test_a_tick_begun_before_the_learner_listened_is_no_gap(ticks: list[list[RecordedMessage]]) -> None:
    live, stream = made(flat(ticks)[2:])
    assert [record.topic for record in stream].count(SESSION_PHASE) == 1
    assert (live.gaps, live.dropped) == (0, 1)


def test_stamps_from_nowhere_neither_move_time_nor_fill_the_memory(ticks: list[list[RecordedMessage]]) -> None:
    far = [altered(ticks[0][0], stamp_ns=10**18 + index) for index in range(1000)]
    live, stream = made(flat(ticks[:5]) + far + flat(ticks[5:]))
    assert [record for record in stream if record.topic != SESSION_PHASE] == flat(ticks)
    assert live.dropped == 1000
    assert len(live._joiner._ticks.open) <= MAX_PENDING


def test_markers_are_followed_and_begin_time_anew(ticks: list[list[RecordedMessage]]) -> None:
    phases = [(0, WASHOUT), (1, LEARN), (2, EVALUATE)]
    heard = flat([[marker(cycle=cycle, phase=phase), *flat(ticks)] for cycle, phase in phases])
    live, stream = made(heard)
    assert stream == heard
    assert live.run == "ab" * 16
    assert (live.ticks, live.gaps, live.steps) == (3 * TICKS, 0, 3 * (TICKS - 1))


def at(ticks: Sequence[Sequence[RecordedMessage]], start_ns: int) -> list[list[RecordedMessage]]:
    """Return ticks that begin at a stamp, at their own pace."""
    return [
        [altered(record, stamp_ns=start_ns + place * PERIOD_NS) for record in tick] for place, tick in enumerate(ticks)
    ]


def test_a_clock_that_begins_anew_is_followed_without_a_marker(ticks: list[list[RecordedMessage]]) -> None:
    """After ten messages of each topic there are ticks again, the first of which follows upon none."""
    late, again = at(ticks, 60 * 10**9), at([*ticks, *ticks], 10**9)
    live, stream = made([*flat(late), *flat(again)], numbered=False)
    assert (live.ticks, live.gaps, live.steps) == (2 * TICKS, 1, 2 * TICKS - 2)
    assert live.refused.total() == 3 * 10
    stamps = [decode(record.type, record.data).stamp_ns for record in stream if record.topic == SAMPLE_JOINTS]
    assert stamps == [60 * 10**9 + place * PERIOD_NS for place in range(TICKS)] + [
        10**9 + place * PERIOD_NS for place in range(10, 2 * TICKS)
    ]


def test_latecomers_and_single_topics_begin_nothing(ticks: list[list[RecordedMessage]]) -> None:
    late = at(ticks, 60 * 10**9)
    near = at([*ticks, *ticks], 51 * 10**9)
    one = [tick[0] for tick in at([*ticks, *ticks], 10**9)]
    live, stream = made([*flat(late), *flat(near)[:60], *one], numbered=False)
    assert live.ticks == TICKS
    assert live.refused.total() == 60 + len(one)
    assert [record.topic for record in stream].count(SESSION_PHASE) == 1


def test_a_marker_of_another_run_is_followed_under_the_name_of_the_first(ticks: list[list[RecordedMessage]]) -> None:
    live, stream = made([*flat(ticks), marker(cycle=3, phase=EVALUATE), *flat(ticks)])
    assert live.run == LIVE_RUN
    assert [parsed(record) for record in stream if record.topic == SESSION_PHASE] == [
        Phase(LIVE_RUN, 0, 0, LEARN, log=""),
        Phase(LIVE_RUN, 0, 3, EVALUATE, log=""),
    ]


def test_numbers_that_stand_still_are_no_gaps(ticks: list[list[RecordedMessage]]) -> None:
    still = [record._replace(sequence=0) for record in flat(ticks)]
    assert made(still)[0].gaps == 0


def test_a_log_is_heard_as_it_would_have_been_live(ticks: list[list[RecordedMessage]], tmp_path: Path) -> None:
    bad = [record for record, _ in wrong_messages(ticks[5]) if record.type]
    heard = flat(ticks[:5]) + bad + flat(ticks[5:7]) + ticks[8][1:] + flat(ticks[9:])
    _, expected = made(heard)
    with LogWriter(tmp_path / "beside.mcap", manifest={"kind": "test"}) as writer:
        for record in heard:
            kind = record.type if record.type != JointState.TYPE or record.topic == SAMPLE_JOINTS else ""
            writer.write(
                record.topic,
                record.data,
                log_time_ns=PERIOD_NS,
                sequence=record.sequence,
                type_name=kind,
                opaque=not kind,
            )
    log = LiveLog(tmp_path / "beside.mcap", check=range_check(ASIMO))
    assert [record[:4] for record in log.stream()] == [record[:4] for record in expected]
    assert list(log.stream(7)) == list(log.stream())[7:]
    assert log.offer().messages == len(expected)
    learned = Trainer(LearnerConfig(), robot=ASIMO)
    assert train_on(log, learned).result()["ticks"] == TICKS - 2


def test_a_log_without_ticks_is_an_error(tmp_path: Path) -> None:
    with LogWriter(tmp_path / "few.mcap", manifest={"kind": "test"}) as writer:
        writer.write(RIGHT_TARGET, PoseStamped(0, np.zeros(3)), log_time_ns=0)
    with pytest.raises(LogError, match=r"few\.mcap: expected complete ticks .* found none; given up 1;"):
        LiveLog(tmp_path / "few.mcap")


def test_markers_of_its_own_are_numbered_from_zero_and_have_the_time_of_the_first_message_that_follows(
    ticks: list[list[RecordedMessage]],
) -> None:
    later = [[left, right._replace(log_time_ns=right.log_time_ns + 1), joints] for left, right, joints in ticks]
    _, stream = made(flat(later[:3] + later[4:]))
    markers = [(record.sequence, record.log_time_ns) for record in stream if record.topic == SESSION_PHASE]
    assert markers == [(0, later[0][0].log_time_ns), (1, later[4][0].log_time_ns)]


def test_its_offer_is_one_presentation_for_learning_in_every_epoch() -> None:
    offer = live_offer(LIVE_RUN, epochs=3, robot={})
    assert offer.schedule == {"epochs": 3, "phases": [["learn", 1]]}
    assert (offer.logs, offer.messages) == ([], None)
