import itertools

import numpy as np
import pytest

from recorders.cdr.codec import encode
from recorders.errors import ConfigError, JointError, MessageError, OutOfRange
from recorders.messages.message_types import JointState, PoseStamped, String
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import (
    LEARNER_TOPICS,
    LEFT_TARGET,
    RIGHT_TARGET,
    SAMPLE_JOINTS,
    commanded_tick,
    hand_target,
    reached_tick,
)
from recorders.ticks import joiner as ticks_module
from recorders.ticks.joiner import JointMap, TickInput, TickJoiner, check_tick_topics, join_ticks

NAMES = ("hip", "elbow", "wrist")


def record(topic, tick, **changes):
    """Return one of the three messages of a tick; its values follow from the tick."""
    if topic == SAMPLE_JOINTS:
        message: JointState | PoseStamped = JointState(
            tick, NAMES, changes.pop("values", np.array([0.1, 0.2, 0.3]) * tick)
        )
    else:
        side = 1 if topic == LEFT_TARGET else -1
        message = PoseStamped(tick, changes.pop("values", np.array([0.3, 0.2 * side, tick])))
    return RecordedMessage(topic, message.TYPE, encode(message), tick, tick)._replace(**changes)


def one_tick(tick):
    return [record(topic.name, tick) for topic in LEARNER_TOPICS]


def run(records):
    joiner = TickJoiner()
    return [tick for item in records for tick in joiner.feed(item)]


def test_a_log_gives_one_tick_per_stamp(ticks):
    joined = list(join_ticks(ticks(20)))
    assert [tick.stamp_ns for tick in joined] == [50_000_000 * k for k in range(20)]
    first = joined[0]
    assert first.hands[0].tolist() == [0.32, 0.2, 0.76]
    assert first.hands[1].tolist() == [0.32, -0.2, 0.76]
    assert first.joints.position.tolist() == (np.arange(15) / 7).tolist()
    assert not first.hands[0].flags.writeable


def test_records_are_the_learner_topics_in_rank_order_whatever_the_order_of_arrival():
    for order in itertools.permutations(one_tick(5)):
        (tick,) = run(order)
        assert list(tick.records) == one_tick(5)
        assert tick.hands[0].tolist() == [0.3, 0.2, 5]
        assert tick.joints.position.tolist() == (np.array([0.1, 0.2, 0.3]) * 5).tolist()


def test_topics_may_run_ahead_of_one_another():
    columns = [[record(topic.name, tick) for tick in range(6)] for topic in LEARNER_TOPICS]
    joined = run(itertools.chain(*columns))
    assert [tick.stamp_ns for tick in joined] == list(range(6))
    assert [tick.records for tick in joined] == [tuple(one_tick(k)) for k in range(6)]


def test_other_topics_are_passed_over():
    other = RecordedMessage("/joint_states", "any", b"not even CDR", 0, 0)
    assert len(run([other, *one_tick(0), other])) == 1


@pytest.mark.parametrize("topic", [LEFT_TARGET, RIGHT_TARGET])
@pytest.mark.parametrize("value", [float("nan"), float("inf"), -float("inf")])
def test_nan_and_infinity_in_a_target_are_refused_by_name(topic, value):
    bad = record(topic, 7, values=np.array([0.1, value, 0.2]))
    with pytest.raises(MessageError, match=f"{topic} #7: expected finite numbers at 7 ns, found {value}"):
        run([bad])


def test_infinities_that_cancel_and_sums_that_overflow_are_told_apart():
    with pytest.raises(MessageError, match="expected finite numbers"):
        run([record(LEFT_TARGET, 0, values=np.array([np.inf, -np.inf, 0]))])
    assert run([record(LEFT_TARGET, 0, values=np.array([1e308, 1e308, 1e308]))]) == []


def test_a_robot_need_not_know_its_velocities_and_efforts():
    """Many publish NaN for what they do not measure; the learner reads positions alone."""
    unknown = np.array([0, np.nan, np.inf])
    message = JointState(1, NAMES, np.arange(3.0), velocity=unknown, effort=unknown)
    joints = RecordedMessage(SAMPLE_JOINTS, message.TYPE, encode(message), 1, 1)
    (tick,) = run([joints, *one_tick(1)[:2]])
    assert JointMap(NAMES).positions(tick.joints).tolist() == [0.0, 1.0, 2.0]


def test_a_wrong_type_is_named():
    message = String("x")
    wrong = RecordedMessage(LEFT_TARGET, message.TYPE, encode(message), 4, 0)
    with pytest.raises(
        MessageError, match=r"/hand/left/target #4: expected geometry_msgs.* found 'std_msgs/msg/String'"
    ):
        run([wrong])


def test_bytes_that_do_not_decode_are_named():
    for data in (b"", b"\x00\x01\x00\x00" + bytes(20), bytes(5000)):
        with pytest.raises(MessageError, match="/sample/joint_states #3: "):
            run([record(SAMPLE_JOINTS, 3, data=data)])


@pytest.mark.parametrize("missing", [topic.name for topic in LEARNER_TOPICS])
def test_a_lost_message_is_named_once_a_later_tick_is_complete(missing):
    records = [item for tick in (1, 2, 3) for item in one_tick(tick)]
    lost = [item for item in records if (item.topic, item.sequence) != (missing, 2)]
    with pytest.raises(MessageError, match=f"the tick at 2 ns lacks {missing}: it has .*#2.* the tick at 3 ns"):
        run(lost)


@pytest.mark.parametrize("topic", [topic.name for topic in LEARNER_TOPICS])
def test_the_same_topic_twice_in_a_tick_is_refused(topic):
    twice = [*one_tick(1)[:1], record(topic, 1), record(topic, 1, sequence=9)]
    with pytest.raises(MessageError, match=r"a second message at 1 ns"):
        run(twice)
    with pytest.raises(MessageError, match=f"{topic} #9: a second message at 1 ns"):
        run([*one_tick(1), record(topic, 1, sequence=9)])


def test_stamps_that_run_backwards_are_refused():
    with pytest.raises(MessageError, match="/hand/left/target #1: stamp 1 ns runs backwards, the one before was 2 ns"):
        run([*one_tick(2), *one_tick(1)])


def test_cycles_repeat_their_stamps_after_finish_or_clear():
    joiner = TickJoiner()
    for end in (joiner.finish, joiner.clear, joiner.finish):
        assert len([tick for item in one_tick(1) for tick in joiner.feed(item)]) == 1
        end()
    joiner.feed(record(LEFT_TARGET, 5))
    joiner.clear()
    joiner.finish()
    assert len([tick for item in one_tick(5) for tick in joiner.feed(item)]) == 1


def test_an_unfinished_tick_at_the_end_is_named():
    joiner = TickJoiner()
    joiner.feed(record(RIGHT_TARGET, 5))
    with pytest.raises(
        MessageError, match="tick at 5 ns lacks /hand/left/target, /sample/joint_states: it has /hand/r"
    ):
        joiner.finish()
    joiner.finish()
    with pytest.raises(MessageError, match="the cycle is over"):
        list(join_ticks(one_tick(1)[:2]))


def test_a_publisher_that_stays_silent_does_not_fill_the_memory(monkeypatch):
    monkeypatch.setattr(ticks_module, "MAX_OPEN", 10)
    with pytest.raises(MessageError, match=r"tick at 0 ns lacks .*/sample/joint_states.* is 10 ticks ahead of it"):
        run(record(LEFT_TARGET, tick) for tick in range(11))


def test_large_messages_are_joined_too():
    names = tuple(f"joint_{index}" for index in range(500))
    message = JointState(1, names, np.zeros(500))
    joints = RecordedMessage(SAMPLE_JOINTS, message.TYPE, encode(message), 1, 1)
    (tick,) = run([joints, *one_tick(1)[:2]])
    assert tick.joints.name == names


@pytest.mark.parametrize("order", list(itertools.permutations(range(3))))
def test_joints_are_mapped_by_name_never_by_place(order):
    values = {"hip": 1.0, "elbow": 2.0, "wrist": 3.0}
    names = [NAMES[index] for index in order]
    message = JointState(0, ["extra", *names], np.array([9.0, *(values[name] for name in names)]))
    joint_map = JointMap(NAMES)
    for _ in range(2):
        assert joint_map.positions(message).tolist() == [1.0, 2.0, 3.0]
    assert not joint_map.positions(message).flags.writeable


def test_joints_that_come_as_they_are_wanted_cannot_be_changed_either():
    found = JointMap(NAMES).positions(JointState(0, NAMES, np.array([1.0, 2.0, 3.0])))
    assert found.tolist() == [1.0, 2.0, 3.0]
    assert not found.flags.writeable


def test_joints_that_nobody_asks_for_may_be_many_and_have_one_name():
    strangers = ("", "", *("mimic",) * 100_000)
    message = JointState(0, (*strangers, *NAMES), np.array([*[np.nan] * len(strangers), 1.0, 2.0, 3.0]))
    assert JointMap(NAMES).positions(message).tolist() == [1.0, 2.0, 3.0]


def test_missing_and_repeated_joints_are_named_with_those_that_exist():
    with pytest.raises(JointError, match="no joint wrist in the message; there are: elbow, hip"):
        JointMap(NAMES).positions(JointState(0, ("elbow", "hip"), np.zeros(2)))
    with pytest.raises(JointError, match="there are: none"):
        JointMap(NAMES).positions(JointState(0, (), np.zeros(0)))
    with pytest.raises(JointError, match="hip twice among the joints of the message"):
        JointMap(NAMES).positions(JointState(0, ("hip", "elbow", "wrist", "hip"), np.zeros(4)))
    with pytest.raises(JointError, match="hip twice among the joints asked for"):
        JointMap(["hip", "hip"])
    with pytest.raises(JointError, match="expected 3 joint positions, found 0"):
        JointMap(NAMES).positions(JointState(0, NAMES, np.zeros(0)))


@pytest.mark.parametrize("error", [JointError("no such joint"), MessageError("too far away")])
def test_what_does_not_pass_the_check_is_named(error):
    def check(value):
        if isinstance(value, JointState):
            raise error

    joiner = TickJoiner(check)
    joiner.feed(record(LEFT_TARGET, 3))
    with pytest.raises(type(error)) as found:
        joiner.feed(record(SAMPLE_JOINTS, 3))
    assert str(found.value) == f"/sample/joint_states #3: {error}"


def test_it_is_idle_where_no_tick_waits():
    joiner = TickJoiner()
    assert joiner.idle is True
    for item, idle in zip(one_tick(1), (False, False, True), strict=True):
        joiner.feed(item)
        assert joiner.idle is idle


def measured(rank, tick):
    topics = reached_tick(("left", "right"))
    message = JointState(tick, NAMES, np.ones(3)) if rank == 2 else PoseStamped(tick, np.ones(3))
    return RecordedMessage(topics[rank], message.TYPE, encode(message), tick, tick)


def test_hands_as_measured_without_joints_are_passed_over_and_joints_without_hands_are_not():
    joiner = TickJoiner(topics=reached_tick(("left", "right")))
    for rank, tick in ((0, 1), (1, 1), (0, 2), (0, 3), (1, 3)):
        joiner.feed(measured(rank, tick))
    assert len(joiner.feed(measured(2, 3))) == 1
    joiner.feed(measured(0, 4))
    joiner.finish()
    joiner.feed(measured(2, 5))
    joiner.feed(measured(0, 5))
    with pytest.raises(MessageError, match=r"tick at 5 ns lacks /hand/right/measured: it has .*/joint_states #5"):
        joiner.finish()


def test_the_first_stamp_may_be_zero_in_every_cycle():
    joiner = TickJoiner()
    for _ in range(2):
        assert len([tick for item in one_tick(0) for tick in joiner.feed(item)]) == 1
        joiner.clear()


def test_joints_are_found_in_any_number_of_layouts_and_few_are_remembered():
    joint_map = JointMap(NAMES)
    for number in range(200):
        message = JointState(0, (f"other_{number}", *NAMES), np.array([9.0, 1.0, 2.0, 3.0]))
        assert joint_map.positions(message).tolist() == [1.0, 2.0, 3.0]
        assert 1 <= len(joint_map._places) <= 64
    assert len(joint_map._places) == 200 - 3 * 64


def test_a_pose_is_read_by_its_reader_and_what_it_refuses_is_named():
    def read(pose):
        if pose.position[0] > 1.0:
            raise OutOfRange("turned too far", finite=True)
        return np.array([*pose.position, 7.0])

    posed = TickInput(LEFT_TARGET, read)
    stamp, value = posed.read(record(LEFT_TARGET, 4))
    assert (stamp, value.tolist()) == (4, [0.3, 0.2, 4.0, 7.0])
    assert TickInput(LEFT_TARGET).read(record(LEFT_TARGET, 4))[1].tolist() == [0.3, 0.2, 4.0]
    with pytest.raises(OutOfRange) as found:
        posed.read(record(LEFT_TARGET, 4, values=np.full(3, 2.0)))
    assert (str(found.value), found.value.finite) == ("/hand/left/target #4: turned too far", True)
    with pytest.raises(MessageError, match="expected finite numbers at 4 ns, found nan"):
        posed.read(record(LEFT_TARGET, 4, values=np.full(3, np.nan)))


@pytest.mark.parametrize("hands", [0, 1, 2, 63])
def test_topics_of_a_tick_are_hands_and_joints(hands):
    topics = commanded_tick([f"hand_{number}" for number in range(hands)])
    assert check_tick_topics(list(topics)) == topics
    assert check_tick_topics(topics[::-1]) == topics[::-1]


@pytest.mark.parametrize(
    "topics",
    [
        [],
        [LEFT_TARGET],
        [LEFT_TARGET, RIGHT_TARGET],
        [LEFT_TARGET, LEFT_TARGET, SAMPLE_JOINTS],
        [LEFT_TARGET, SAMPLE_JOINTS, SAMPLE_JOINTS],
        [LEFT_TARGET, SAMPLE_JOINTS, "/clock"],
        [*(hand_target(f"hand_{number}") for number in range(64)), SAMPLE_JOINTS],
    ],
)
def test_other_topics_are_no_tick(topics):
    with pytest.raises(ConfigError, match="expected as a tick's topics hands, each once, and one of joints, found"):
        check_tick_topics(topics)
