"""Plain playback: every message of the logs, unchanged, in one order; sliced, renamed, repeated as asked."""

import hashlib
import json
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from itertools import islice
from pathlib import Path

import pytest
from episodes import PERIOD_NS, write_episode
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.writer import Writer
from sessions import split
from waiting import wait_until

from recorders.errors import ConfigError, LogError, WireError
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import LEFT_TARGET, RIGHT_TARGET, SAMPLE_JOINTS
from recorders.protocol.stream import MAX_MESSAGE
from recorders.reading.parts import Parts
from recorders.reading.reader import LogReader
from recorders.recording.config import RecordConfig
from recorders.wire.loopback import free_endpoint
from recorders.wire.session import SessionConfig, open_session
from replay.sources.playback import Playback, PlaybackConfig
from replay.transports.sender_config import SenderConfig
from replay.transports.zenoh import ZenohTransport

TODAY_NS = 1_790_000_000_123_456_789
TIMES_NS = (TODAY_NS, TODAY_NS + 1, 2**63 - 2, 2**63 + 1, 2**64 - 1000)


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_episode(tmp_path_factory.mktemp("playback") / "log.mcap", samples=9)


def test_it_is_the_log(log: Path) -> None:
    assert list(Playback([log]).stream()) == list(LogReader(log))


def test_it_begins_at_any_message(log: Path) -> None:
    assert list(Playback([log]).stream(7)) == list(LogReader(log))[7:]


def test_a_slice_is_taken_by_time(log: Path) -> None:
    config = PlaybackConfig(start_ns=2 * PERIOD_NS, end_ns=5 * PERIOD_NS)
    times = [record.log_time_ns for record in Playback([log], config).stream()]
    assert times == [tick * PERIOD_NS for tick in (2, 3, 4) for _ in range(3)]


def test_topics_are_chosen_and_renamed(log: Path) -> None:
    config = PlaybackConfig(topics=frozenset({LEFT_TARGET}), renames={LEFT_TARGET: "/other"})
    played = list(Playback([log], config).stream())
    chosen = [record for record in LogReader(log) if record.topic == LEFT_TARGET]
    assert played == [record._replace(topic="/other") for record in chosen]


def test_it_loops(log: Path) -> None:
    once = list(LogReader(log))
    assert list(Playback([log], PlaybackConfig(loops=3)).stream()) == once * 3
    assert list(islice(Playback([log], PlaybackConfig(loops=0)).stream(), len(once) * 5)) == once * 5


def test_several_logs_are_one_stream_in_the_order_of_time(log: Path, tmp_path: Path) -> None:
    other = write_episode(tmp_path / "other.mcap", samples=4)
    played = list(Playback([log, other]).stream())
    assert len(played) == 3 * (10 + 5)
    assert [record.log_time_ns for record in played] == sorted(record.log_time_ns for record in played)
    assert [record for record in played[:6] if record.topic == SAMPLE_JOINTS]


def test_the_run_names_what_is_played(log: Path) -> None:
    run = Playback([log]).offer().run
    assert Playback([log]).offer().run == run
    assert Playback([log], PlaybackConfig(loops=2)).offer().run != run
    assert Playback([log], PlaybackConfig(topics=frozenset({RIGHT_TARGET}))).offer().run != run


def test_a_log_is_offered_with_the_hash_of_its_content_or_of_its_file(log: Path, tmp_path: Path) -> None:
    theirs = log_of(tmp_path / "theirs.mcap", 5)
    whole = Parts(tuple(split(log, tmp_path / "parts.mcap", at=[7])))
    stated = LogReader(log).manifest["content_sha256"]
    expected = [
        {"name": "log.mcap", "sha256": stated},
        {"name": "theirs.mcap", "sha256": hashlib.sha256(theirs.read_bytes()).hexdigest()},
    ]
    assert Playback([log, theirs]).offer().logs == expected
    assert [part["sha256"] for part in Playback([whole]).offer().logs] == [stated]


def test_an_unknown_topic_is_named_with_those_there_are(log: Path) -> None:
    with pytest.raises(LogError, match=r"no topic /nothing in the logs; there are: /hand/left/target"):
        Playback([log], PlaybackConfig(topics=frozenset({"/nothing"})))
    with pytest.raises(LogError, match=r"--map: expected a topic /nothing, found none; there are: /hand/left/target"):
        Playback([log], PlaybackConfig(renames={"/nothing": "/other"}))


def test_no_log_is_an_error() -> None:
    with pytest.raises(LogError, match="at least one log"):
        Playback([])


def log_of(path: Path, *times_ns: int, topic: str = "/t", chunk_size: int = 1024 * 1024) -> Path:
    """Write a log with one message at each time, in this order, as the library does it."""
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=chunk_size)
        writer.start()
        channel = writer.register_channel(topic, "cdr", 0)
        for number, time_ns in enumerate(times_ns):
            writer.add_message(channel, time_ns, b"\0\1\0\0", time_ns, number)
        writer.finish()
    return path


def played_times(log: Path, **config: int) -> list[int]:
    return [record.log_time_ns for record in Playback([log], PlaybackConfig(**config)).stream()]


@pytest.mark.parametrize("first_ns", TIMES_NS)
def test_every_message_plays_and_slices_are_exact_at_any_time(tmp_path: Path, first_ns: int) -> None:
    times_ns = [first_ns + step for step in range(0, 900, 3)]
    log = log_of(tmp_path / "log.mcap", *times_ns)
    assert played_times(log) == times_ns
    assert played_times(log, start_ns=1) == times_ns[1:]
    assert played_times(log, start_ns=3, end_ns=897) == times_ns[1:-1]
    assert played_times(log, end_ns=898) == times_ns
    assert played_times(log, end_ns=1) == times_ns[:1]


def test_a_slice_counts_from_the_earliest_message_played_or_not(tmp_path: Path) -> None:
    first, second = (log_of(tmp_path / f"{at}.mcap", TODAY_NS + at, topic=f"/{at}") for at in (0, 5))
    config = PlaybackConfig(topics=frozenset({"/5"}), start_ns=5)
    assert [record.topic for record in Playback([second, first], config).stream()] == ["/5"]
    assert [record.topic for record in Playback([second, first], replace(config, start_ns=4, end_ns=6)).stream()] == [
        "/5"
    ]


@settings(max_examples=25)
@given(
    steps_ns=st.lists(st.integers(-(10**12), 10**12), min_size=1, max_size=20), at=st.sampled_from((TODAY_NS, 2**63))
)
def test_nothing_is_lost_where_a_clock_steps_back(
    tmp_path_factory: pytest.TempPathFactory, steps_ns: list[int], at: int
) -> None:
    folder = tmp_path_factory.mktemp("stepped")
    times_ns = [at + sum(steps_ns[:count]) for count in range(len(steps_ns) + 1)]
    log = log_of(folder / "log.mcap", *times_ns, chunk_size=64)
    other = log_of(folder / "other.mcap", *(time_ns + 1 for time_ns in times_ns), topic="/other")
    both = sorted([*times_ns, *(time_ns + 1 for time_ns in times_ns)])
    assert sorted(played_times(log)) == sorted(times_ns)
    assert sorted(record.log_time_ns for record in Playback([log, other]).stream()) == both
    middle_ns = both[len(both) // 2] - both[0]
    parts = (PlaybackConfig(end_ns=middle_ns + 1), PlaybackConfig(start_ns=middle_ns + 1))
    sliced = [list(Playback([log, other], part).stream()) if part.end_ns else rest(log, other, part) for part in parts]
    assert sorted(record.log_time_ns for part in sliced for record in part) == both


def rest(log: Path, other: Path, config: PlaybackConfig) -> list[RecordedMessage]:
    """Return what plays, nothing where the slice holds no message."""
    try:
        return list(Playback([log, other], config).stream())
    except LogError:
        return []


def test_a_message_that_is_too_large_is_refused_at_the_start_unless_it_is_not_played(tmp_path: Path) -> None:
    log = tmp_path / "log.mcap"
    with log.open("wb") as file:
        writer = Writer(file)
        writer.start()
        for topic, size in (("/t", 10), ("/camera", MAX_MESSAGE + 1), ("/photos", MAX_MESSAGE)):
            writer.add_message(writer.register_channel(topic, "cdr", 0), 0, bytes(size), 0)
        writer.finish()
    with pytest.raises(LogError, match=rf"/camera #0: expected at most {MAX_MESSAGE} bytes .* with --topic"):
        Playback([log])
    chosen = PlaybackConfig(topics=frozenset({"/t", "/photos"}))
    assert [len(record.data) for record in Playback([log], chosen).stream()] == [10, MAX_MESSAGE]


NO_TOPICS = ("/a//b", "x#y", "", "/", "/ok/", "a*b", "/**", "/a?", "/$", "/@consumer/learner/ack", "/a/@b", "/a\0b")


def log_on(path: Path, *topics: str) -> Path:
    """Write a log with one message on each topic, as the library does it, which writes any name."""
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        for topic in topics:
            writer.add_message(writer.register_channel(topic, "cdr", 0), 0, b"\0\1\0\0", 0)
        writer.finish()
    return path


@pytest.mark.parametrize("topic", [*NO_TOPICS, "/" + "x" * 2000])
def test_a_topic_that_is_no_single_key_is_not_played(tmp_path: Path, topic: str) -> None:
    log = log_on(tmp_path / "log.mcap", topic, "/good")
    with pytest.raises(WireError, match="topic: expected names with '/' between them"):
        Playback([log])
    assert [record.topic for record in Playback([log], PlaybackConfig(topics=frozenset({"/good"}))).stream()] == [
        "/good"
    ]
    played = Playback([log], PlaybackConfig(renames={topic: "/renamed"})).stream()
    assert sorted(record.topic for record in played) == ["/good", "/renamed"]


@pytest.mark.parametrize("topic", NO_TOPICS)
def test_no_topic_is_renamed_to_what_is_no_single_key(log: Path, topic: str) -> None:
    with pytest.raises(WireError, match="topic: expected names with '/' between them"):
        Playback([log], PlaybackConfig(renames={LEFT_TARGET: topic}))


@pytest.mark.parametrize("other", [RIGHT_TARGET, RIGHT_TARGET.removeprefix("/")])
def test_two_topics_cannot_be_played_as_one(log: Path, other: str) -> None:
    renames = {LEFT_TARGET: other}
    with pytest.raises(ConfigError, match=r"/hand/left/target and /hand/right/target both as"):
        Playback([log], PlaybackConfig(renames=renames))
    chosen = frozenset({LEFT_TARGET})
    assert next(Playback([log], PlaybackConfig(topics=chosen, renames=renames)).stream()).topic == other


@pytest.mark.parametrize("slice_ns", [(10**18, None), (2**64 - 1, None), (2**63, 2**64), (10_000_000, 20_000_000)])
def test_a_slice_with_nothing_in_it_is_an_error(log: Path, slice_ns: tuple[int, int | None]) -> None:
    with pytest.raises(LogError, match=r"expected messages in the slice from \d"):
        Playback([log], PlaybackConfig(start_ns=slice_ns[0], end_ns=slice_ns[1]))


def test_a_log_without_messages_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(LogError, match=r"empty\.mcap, found none"):
        Playback([log_on(tmp_path / "empty.mcap")])


def test_the_offer_says_how_many_messages_where_that_is_known(log: Path) -> None:
    assert Playback([log, log]).offer().messages == 2 * len(list(LogReader(log)))
    config = PlaybackConfig(topics=frozenset({LEFT_TARGET}), loops=3)
    assert Playback([log], config).offer().messages == len(list(Playback([log], config).stream()))
    for unknown in (PlaybackConfig(loops=0), PlaybackConfig(start_ns=PERIOD_NS), PlaybackConfig(end_ns=PERIOD_NS)):
        assert Playback([log], unknown).offer().messages is None


@pytest.mark.parametrize(
    "options",
    [
        {"start_ns": -1},
        {"start_ns": 2**64},
        {"start_ns": 2, "end_ns": 2},
        {"end_ns": 0},
        {"loops": -1},
    ],
)
def test_numbers_out_of_range_are_refused(options: dict[str, int]) -> None:
    with pytest.raises(ConfigError, match="expected"):
        PlaybackConfig(**options)


def test_whoever_begins_to_listen_just_after_it_began_hears_all_of_it(
    log: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("recorders.wire.sender._LISTENER_WAIT_S", 120.0)  # "just after" is not long
    heard: list[bytes] = []
    endpoint = free_endpoint()
    with (
        open_session(SessionConfig(listen=(endpoint,))) as listening,
        open_session(SessionConfig(connect=(endpoint,))) as playing,
        ThreadPoolExecutor() as threads,
    ):
        playback = Playback([log])
        transport = ZenohTransport(playing, config=SenderConfig(consumers=(), batch_size=1))
        delivered = threads.submit(transport.deliver, playback.offer(), playback.stream)
        wait_until(lambda: delivered.running() or delivered.done())
        listening.declare_subscriber("reenact/hand/*/target", lambda sample: heard.append(sample.payload.to_bytes()))
        assert delivered.result(timeout=120) == {}
        expected = [record.data for record in LogReader(log) if record.topic != SAMPLE_JOINTS]
        wait_until(lambda: len(heard) >= len(expected))
    assert heard == expected
    assert caplog.messages == []


def test_that_nobody_listens_is_said_and_it_plays_all_the_same(log: Path, caplog: pytest.LogCaptureFixture) -> None:
    with open_session(SessionConfig(listen=(free_endpoint(),))) as session:
        playback = Playback([log])
        transport = ZenohTransport(session, config=SenderConfig(consumers=(), batch_size=1))
        assert transport.deliver(playback.offer(), playback.stream) == {}
    assert caplog.messages == ["nobody listens in namespace 'reenact' yet; the stream begins all the same"]


def test_topics_are_chosen_by_patterns_as_record_chooses_them(log: Path) -> None:
    for patterns, expected in (
        ({"/hand/*"}, {LEFT_TARGET, RIGHT_TARGET}),
        ({"*/target"}, {LEFT_TARGET, RIGHT_TARGET}),
        ({"/hand/l*", SAMPLE_JOINTS}, {LEFT_TARGET, SAMPLE_JOINTS}),
        ({"/hand/[!l]*"}, {RIGHT_TARGET}),
    ):
        played = Playback([log], PlaybackConfig(topics=frozenset(patterns)))
        assert {record.topic for record in played.stream()} == expected
        assert played.offer().messages == len(list(played.stream()))
        wants = RecordConfig(include=tuple(patterns)).wants
        assert {topic for topic in LogReader(log).topics if wants(topic)} == expected


def test_a_pattern_that_no_topic_matches_is_an_error(log: Path) -> None:
    with pytest.raises(LogError, match=r"--topic: no topic /foot/\* in the logs; there are: /hand/left/target"):
        Playback([log], PlaybackConfig(topics=frozenset({"/hand/*", "/foot/*"})))


def test_the_run_of_a_plain_playback_is_the_hash_of_its_logs_and_options_alone(log: Path) -> None:
    """Consumers go on with a stream by this name: it is the same in every version."""
    stated = LogReader(log).manifest["content_sha256"]
    plain = json.dumps([[stated], [], [], 0, None, 1])
    assert Playback([log]).offer().run == hashlib.sha256(plain.encode()).hexdigest()[:32]
    for option, more in ({"latched_first": True}, [True, None]), ({"clock_period_ns": 5}, [False, 5]):
        named = json.dumps([[stated], [], [], 0, None, 1, *more])
        found = Playback([log], PlaybackConfig(**option)).offer().run
        assert found == hashlib.sha256(named.encode()).hexdigest()[:32]
