"""The served controller answers as an evaluation does, refuses what is no target, and learns as a training does."""

import time
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from episodes import write_episode
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.evaluation.errors import WASHOUT_STEPS, predicted_joints
from pipeline.learner.controller import Controller
from pipeline.learner.rules.reservoir.config import LearnerConfig
from pipeline.learner.rules.reservoir.learner import Learner
from pipeline.learner.state import state_digest
from pipeline.robot.config import load_robot
from pipeline.samples.pairs import Samples, read_samples
from pipeline.serving.clock_reset import RESTART_AFTER
from pipeline.serving.commands import Command
from pipeline.serving.config import ServingConfig
from pipeline.serving.rejections import Rejection
from pipeline.serving.served_controller import ServedController
from pipeline.serving.tick_stream import MAX_OPEN
from pipeline.training.trainer import Trainer, train
from recorders.cdr.codec import decode_as, encode
from recorders.errors import ConfigError, ControllerError
from recorders.messages.message_types import JointState, Message, PoseStamped, String
from recorders.messages.phase import Phase
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import (
    JOINT_COMMANDS,
    JOINT_STATES,
    LEFT_TARGET,
    RIGHT_TARGET,
    SAMPLE_JOINTS,
    SESSION_PHASE,
)
from recorders.reading.reader import LogReader
from replay.sources.schedule import Schedule
from replay.sources.scheduled import Replay
from replay.transports.transport import InProcess

CENTRE = load_robot("asimo").input_centre


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_episode(tmp_path_factory.mktemp("serving") / "log.mcap", samples=40)


@pytest.fixture(scope="module")
def controller(log: Path) -> Controller:
    return train([log], schedule=Schedule(epochs=3), config=LearnerConfig(seed=1)).controller()


@pytest.fixture(scope="module")
def samples(log: Path) -> Samples:
    return read_samples(log)


def record(topic: str, message: Message) -> RecordedMessage:
    return RecordedMessage(topic, message.TYPE, encode(message), 0, 0)


def pair(stamp_ns: int, u: Iterable[float] = CENTRE) -> list[RecordedMessage]:
    left, right = np.reshape(np.array(u), (2, 3))
    return [record(LEFT_TARGET, PoseStamped(stamp_ns, left)), record(RIGHT_TARGET, PoseStamped(stamp_ns, right))]


def feed(served: ServedController, records: Iterable[RecordedMessage]) -> list[Command]:
    return [command for record in records if (command := served.take(record)) is not None]


def positions(command: Command) -> np.ndarray:
    return decode_as(JointState, command.data).position


def state_of(served: ServedController) -> str:
    return str(served.status()["digest"])


def test_the_commands_for_a_motion_are_the_postures_of_its_evaluation(controller: Controller, samples: Samples) -> None:
    served = ServedController(controller)
    expected = predicted_joints(controller.learner(), samples.targets, 15)
    robot = samples.robot
    commands = feed(served, [m for k, u in enumerate(samples.targets) for m in pair(k * 7, u)])
    assert [command.stamp_ns for command in commands] == [k * 7 for k in range(len(samples.targets))]
    postures = np.array([positions(command) for command in commands])
    assert postures.tobytes() == np.clip(expected, robot.lower, robot.upper).tobytes()
    within = ((robot.lower <= expected) & (expected <= robot.upper)).all(axis=1)
    assert within.sum() > 20
    assert postures[within].tobytes() == expected[within].tobytes()


def test_a_command_is_the_message_that_the_codec_writes(controller: Controller) -> None:
    (command,) = feed(ServedController(controller), pair(3 * 10**9 + 5))
    message = decode_as(JointState, command.data)
    assert message.stamp_ns == 3 * 10**9 + 5
    assert message.name == controller.joints
    assert command.data == encode(JointState(message.stamp_ns, controller.joints, message.position))
    assert [answered.topic for answered in command.answered] == [LEFT_TARGET, RIGHT_TARGET]


def test_the_order_of_a_pair_does_not_matter(controller: Controller) -> None:
    one, other = ServedController(controller), ServedController(controller)
    forward, backward = feed(one, pair(1)), feed(other, reversed(pair(1)))
    assert [command.data for command in forward] == [command.data for command in backward]
    assert state_of(one) == state_of(other)


def test_what_follows_a_command_is_done_by_the_next_message_if_not_before(controller: Controller) -> None:
    """Whoever sends a command settles after it; whoever does not gets the same commands, counts and state."""
    settling, lazy = ServedController(controller), ServedController(controller)
    for tick in range(10):
        records = pair(tick, CENTRE + 0.01 * tick)
        (prompt,), (late,) = feed(settling, records), feed(lazy, records)
        settling.settle()
        settling.settle()
        assert prompt == late
    assert settling.status() == lazy.status()


COORDINATES = st.sampled_from([0.0, 0.32, 0.2, -0.2, 0.76, 0.6, 9.0, 1e9, np.nan, np.inf])


@st.composite
def messages(draw: st.DrawFn, *, about_ns: int) -> RecordedMessage:
    topic = draw(st.sampled_from([LEFT_TARGET, RIGHT_TARGET, LEFT_TARGET, RIGHT_TARGET, SAMPLE_JOINTS, JOINT_COMMANDS]))
    hand = CENTRE[:3] if topic == LEFT_TARGET else CENTRE[3:]
    place = draw(st.one_of(st.just(hand), st.tuples(COORDINATES, COORDINATES, COORDINATES)))
    pose = encode(PoseStamped(draw(st.integers(max(0, about_ns - 2), about_ns + 2)), np.array(place)))
    if draw(st.integers(0, 5)) == 0:  # another byte order, frame or time, some of them of no message
        at, other = draw(st.integers(0, 23)), draw(st.sampled_from([0, 1, 2, 127, 128, 255]))
        pose = pose[:at] + bytes([other]) + pose[at + 1 :]
    kind = draw(st.sampled_from([PoseStamped.TYPE] * 5 + [JointState.TYPE]))
    return RecordedMessage(topic, kind, pose[: draw(st.sampled_from([len(pose)] * 6 + [len(pose) - 1, 3]))], 0, 0)


@st.composite
def streams(draw: st.DrawFn) -> list[list[RecordedMessage]]:
    """Messages by twos, most of them the hands of a tick."""
    pairs = []
    for tick in range(draw(st.integers(2, 24))):
        if draw(st.integers(0, 3)):
            usual = pair(tick, CENTRE + 0.01 * draw(st.integers(-20, 20)))
            pairs.append(usual if draw(st.booleans()) else usual[::-1])
        else:
            pairs.append([draw(messages(about_ns=tick)) for _ in range(2)])
    return pairs


def feed_pair(served: ServedController, first: RecordedMessage, second: RecordedMessage) -> list[Command]:
    """Feed two messages as the node does: as a usual pair if they may be one, else one after the other."""
    left, right = (second, first) if first.topic == RIGHT_TARGET else (first, second)
    if (left.topic, right.topic) == (LEFT_TARGET, RIGHT_TARGET) and left.type == PoseStamped.TYPE == right.type:
        answer = served.answer_pair(left.data, right.data)
        if answer is not None:
            return [Command(*answer, (left, right))]
    return feed(served, [first, second])


@settings(max_examples=60)
@given(pairs=streams(), learn=st.integers(0, 3).map(lambda drawn: drawn == 0))
def test_a_pair_is_taken_as_its_messages_are_one_after_the_other(
    controller: Controller, pairs: list[list[RecordedMessage]], learn: bool
) -> None:
    at_once, singly = (ServedController(controller, config=ServingConfig(learn=learn)) for _ in range(2))
    for first, second in pairs:
        commands = feed(singly, [first, second])
        assert feed_pair(at_once, first, second) == commands
    assert at_once.status() == singly.status()


def test_which_pairs_are_usual(controller: Controller) -> None:
    """The first of a cycle asks for the washout, half a tick waits, and learning needs more: none of them is."""
    served, learning = ServedController(controller), ServedController(controller, config=ServingConfig(learn=True))
    poses = [[record.data for record in pair(stamp)] for stamp in range(6)]
    assert served.answer_pair(*poses[1]) is None
    (first,) = feed(served, pair(1))
    assert served.answer_pair(*poses[1]) is None  # it is stale
    answer = served.answer_pair(*poses[2])
    assert answer is not None
    assert answer[0] == 2
    feed(served, pair(4)[:1])
    assert served.answer_pair(*poses[3]) is None
    assert served.answer_pair(*poses[4]) is None
    (other,) = feed(served, pair(4)[1:])
    assert (first.stamp_ns, other.stamp_ns) == (1, 4)
    assert served.answer_pair(*poses[5]) is not None
    for stamp in (1, 2):
        feed(learning, [*pair(stamp), record(SAMPLE_JOINTS, JointState(stamp, controller.joints, np.zeros(15)))])
        assert learning.answer_pair(*poses[stamp + 1]) is None


@pytest.mark.parametrize("sign", [-1.0, 1.0])
@pytest.mark.parametrize("axis", range(6))
def test_a_pair_beyond_the_usual_is_left_to_the_general_path(controller: Controller, axis: int, sign: float) -> None:
    served = ServedController(controller)
    feed(served, pair(1))
    for stamp, distance in enumerate((0.2499, 0.2501, np.inf, np.nan), start=2):
        u = CENTRE.copy()
        u[axis] += sign * distance
        answer = served.answer_pair(*(record.data for record in pair(stamp, u)))
        assert (answer is not None) == (distance == 0.2499)


HEAD = len(encode(PoseStamped(0, np.zeros(3)))) - 56  # all before the seven numbers: encapsulation, stamp, frame


@pytest.mark.parametrize("at", range(HEAD))
def test_a_pair_with_a_head_of_its_own_is_taken_as_its_messages_are(controller: Controller, at: int) -> None:
    at_once, singly = ServedController(controller), ServedController(controller)
    for k, byte in enumerate([None, None, 0, 1, 2, 63, 127, 128, 255]):  # the first pair gets the washout
        records = pair((k + 1) * 10**9 + 7)
        if byte is not None:
            changed = [record.data[:at] + bytes([byte]) + record.data[at + 1 :] for record in records]
            records = [record._replace(data=data) for record, data in zip(records, changed, strict=True)]
        assert feed_pair(at_once, *records) == feed(singly, records)
    assert at_once.status() == singly.status()


def test_joint_limits_are_kept_and_counted_by_joint(controller: Controller) -> None:
    tight = tighten(controller, joint="head_pan", lower=-1e-6, upper=1e-6)
    served = ServedController(tight)
    free = feed(ServedController(controller), pair(1))[0]
    (command,) = feed(served, pair(1))
    place = controller.joints.index("head_pan")
    assert abs(positions(free)[place]) > 1e-6
    assert abs(positions(command)[place]) == 1e-6
    assert np.array_equal(np.delete(positions(command), place), np.delete(positions(free), place))
    assert served.status()["clipped"].keys() - ServedController(controller).status()["clipped"].keys() == {"head_pan"}
    assert served.status()["clipped"]["head_pan"] == 1


def tighten(controller: Controller, *, joint: str, lower: float, upper: float) -> Controller:
    from xml.etree import ElementTree

    urdf = ElementTree.fromstring(controller.robot_urdf)
    (limit,) = urdf.findall(f"joint[@name='{joint}']/limit")
    limit.attrib |= {"lower": str(lower), "upper": str(upper)}
    return replace(controller, robot_urdf=ElementTree.tostring(urdf, encoding="unicode"))


NAN = [np.nan, *CENTRE[1:]]
INFINITE = [*CENTRE[:5], -np.inf]
FAR = [*CENTRE[:5], 1e300]


@pytest.mark.parametrize(
    ("bad", "reason"),
    [
        ([pair(10)[0]], Rejection.STALE),
        ([pair(9)[1]], Rejection.STALE),
        ([pair(20, NAN)[0]], Rejection.NOT_FINITE),
        ([pair(20, INFINITE)[1]], Rejection.NOT_FINITE),
        ([pair(20, FAR)[1]], Rejection.OUT_OF_RANGE),
        ([pair(20)[0], pair(20)[0]], Rejection.REPEATED),
        ([record(LEFT_TARGET, JointState(20, ("a",), np.zeros(1)))], Rejection.WRONG_TYPE),
        ([pair(20)[0]._replace(data=b"")], Rejection.UNDECODABLE),
        ([pair(20)[0]._replace(data=encode(JointState(20, ("a",), np.zeros(1))))], Rejection.UNDECODABLE),
        ([pair(20)[0]._replace(data=pair(20)[0].data[:-1])], Rejection.UNDECODABLE),
        ([pair(20)[0]._replace(data=b"\xff" * 96)], Rejection.UNDECODABLE),
        ([record(SESSION_PHASE, String("no marker"))], Rejection.UNDECODABLE),
    ],
)
def test_what_is_no_target_is_refused_and_changes_nothing(
    controller: Controller, bad: list[RecordedMessage], reason: Rejection, caplog: pytest.LogCaptureFixture
) -> None:
    served, undisturbed = ServedController(controller), ServedController(controller)
    feed(served, pair(10))
    feed(undisturbed, pair(10))
    before = state_of(served)
    assert feed(served, bad) == []
    status = served.status()
    assert status["refused"] == {reason.value: 1}
    (line,) = caplog.messages
    assert line.startswith(f"refused, {reason.value}: ")
    assert line.endswith(status["last_refusal"])
    assert status["digest"] == before
    assert [c.data for c in feed(served, pair(30))] == [c.data for c in feed(undisturbed, pair(30))]


def test_a_text_from_the_network_is_made_printable(controller: Controller, caplog: pytest.LogCaptureFixture) -> None:
    served = ServedController(controller, config=ServingConfig(learn=True))
    served.take(record(SAMPLE_JOINTS, JointState(1, ("\x1b[2J\nroot",), np.zeros(1))))
    assert served.status()["refused"] == {"wrong joints": 1}
    assert caplog.messages[0].isprintable()


def test_halves_are_dropped_and_counted_when_a_newer_pair_is_complete(controller: Controller) -> None:
    served, undisturbed = ServedController(controller), ServedController(controller)
    late = pair(5)
    feed(served, [pair(1)[0], pair(2)[1], late[0], *pair(3)])
    assert served.status()["refused"] == {"no partner": 2}
    assert served.status()["last_refusal"] == "/hand/right/target: /hand/left/target at 2 ns never came"
    assert len(feed(served, [late[1]])) == 1
    feed(undisturbed, [*pair(3), *pair(5)])
    assert state_of(served) == state_of(undisturbed)


def test_halves_alone_do_not_fill_the_memory_nor_push_out_what_is_due(controller: Controller) -> None:
    served = ServedController(controller)
    feed(served, [pair(10**12 + k)[0] for k in range(3 * MAX_OPEN)])
    assert served.status()["refused"] == {"no partner": 2 * MAX_OPEN}
    assert len(feed(served, pair(1))) == 1


def test_of_too_many_halves_the_latest_are_kept(controller: Controller) -> None:
    served = ServedController(controller)
    pairs = [pair(10 + k) for k in range(MAX_OPEN + 1)]
    feed(served, [left for left, _ in pairs])
    assert served.status()["refused"] == {"no partner": 1}
    assert served.status()["last_refusal"].endswith("at 10 ns never came")
    assert [len(feed(served, [right])) for _, right in pairs[1:]] == [1] * MAX_OPEN


def test_two_hands_of_different_instants_are_never_one_command(controller: Controller) -> None:
    served = ServedController(controller)
    feed(served, pair(1))
    (left, _), (_, right) = pair(10), pair(11)
    assert served.answer_pair(left.data, right.data) is None
    assert feed(served, [left, right]) == []
    assert served.between_ticks is False


def test_a_target_outside_is_counted_and_served(controller: Controller) -> None:
    served = ServedController(controller)
    assert len(feed(served, pair(1, CENTRE + 0.3))) == 1
    assert served.status()["outside"] == 2


def test_a_wide_area_lets_no_target_pass_that_cannot_be_the_robots(controller: Controller) -> None:
    served = ServedController(controller, config=ServingConfig(outside_m=10.0))
    feed(served, pair(1))
    far = pair(2, [*CENTRE[:5], 9.0])
    assert served.answer_pair(far[0].data, far[1].data) is None
    assert feed(served, far) == []
    assert served.status()["refused"] == {"out of range": 1}


def test_a_marker_begins_a_cycle_with_a_washout_of_its_own(controller: Controller) -> None:
    served = ServedController(controller)
    marker = record(SESSION_PHASE, Phase("run", 0, 0, "evaluate", "log").to_message())
    first = feed(served, [*pair(10), *pair(20, CENTRE + 0.01)])
    again = feed(served, [marker, *pair(10), *pair(20, CENTRE + 0.01)])
    assert [command.data for command in again] == [command.data for command in first]


@pytest.mark.parametrize("learn", [False, True])
def test_a_clock_that_begins_anew_is_followed_after_some_ticks_and_that_is_said_once(
    controller: Controller, log: Path, learn: bool, caplog: pytest.LogCaptureFixture
) -> None:
    config = ServingConfig(learn=learn, washout_steps=0)
    served = ServedController(controller, config=config)
    assert len(feed(served, whole_tick(10**18))) == 1
    stale = [whole_tick(k) for k in range(1, RESTART_AFTER + 1)]
    assert feed(served, [m for tick in stale for m in tick if learn or m.topic != SAMPLE_JOINTS]) == []
    assert len(feed(served, whole_tick(RESTART_AFTER + 1))) == 1
    assert served.status()["refused"] == {"stale": RESTART_AFTER * (3 if learn else 2)}
    again = [whole_tick(10**18 + k) for k in range(1, RESTART_AFTER + 2)]
    assert len(feed(served, [m for tick in again for m in tick if learn or m.topic != SAMPLE_JOINTS])) == 1
    feed(served, [m for tick in stale for m in tick if learn or m.topic != SAMPLE_JOINTS])
    assert [line for line in caplog.messages if "a new cycle begins" in line] == [
        f"{RESTART_AFTER} ticks in a row are stale, the last at {RESTART_AFTER} ns after one at {10**18} ns: "
        "a new cycle begins with the next"
    ]


def whole_tick(stamp_ns: int) -> list[RecordedMessage]:
    robot = load_robot("asimo")
    return [*pair(stamp_ns), record(SAMPLE_JOINTS, JointState(stamp_ns, robot.joints, robot.comfort))]


@pytest.mark.parametrize("usual", [False, True])
def test_a_pair_from_far_ahead_moves_no_robot_and_delays_no_later_one(controller: Controller, usual: bool) -> None:
    served, undisturbed = ServedController(controller), ServedController(controller)
    feed(served, pair(1))
    feed(undisturbed, pair(1))
    for k in range(2, 3 * RESTART_AFTER):
        forged = pair(10**18 + k, CENTRE + 0.1)
        if usual:
            assert served.answer_pair(forged[0].data, forged[1].data) is None
        assert feed(served, forged) == []
        assert [c.data for c in feed(served, pair(k))] == [c.data for c in feed(undisturbed, pair(k))] != []
    assert served.status()["refused"] == {"ahead": 2 * (3 * RESTART_AFTER - 2)}


def test_a_pause_is_no_leap_but_a_clock_that_leaps_is_followed(
    controller: Controller, monkeypatch: pytest.MonkeyPatch
) -> None:
    now_ns = 5
    monkeypatch.setattr(time, "monotonic_ns", lambda: now_ns)
    served = ServedController(controller)
    assert len(feed(served, pair(1))) == 1
    served.settle()
    now_ns += 3600 * 10**9
    assert len(feed(served, pair(1 + 3600 * 10**9))) == 1  # as long as the pause was
    leapt = [message for k in range(RESTART_AFTER + 1) for message in pair(10**18 + k)]
    assert [command.stamp_ns for command in feed(served, leapt)] == [10**18 + RESTART_AFTER]
    assert served.status()["refused"] == {"ahead": 2 * RESTART_AFTER}


def test_late_messages_that_do_not_go_on_begin_nothing(controller: Controller) -> None:
    """Neither one topic alone, nor one tick again and again, nor ticks between others that are answered."""
    served = ServedController(controller)
    feed(served, pair(10**9))
    late = [pair(k)[0] for k in range(3 * RESTART_AFTER)] + pair(5) * 3 * RESTART_AFTER
    late += [m for k in range(3 * RESTART_AFTER) for m in [*pair(k), *pair(10**9 + 1 + k)]]
    assert len(feed(served, late)) == 3 * RESTART_AFTER
    assert served.take(pair(10**9)[0]) is None
    assert served.status()["refused"] == {"stale": 3 * 5 * RESTART_AFTER + 1}


def ticks(log: Path) -> list[RecordedMessage]:
    return [r for r in LogReader(log) if r.topic in (LEFT_TARGET, RIGHT_TARGET, SAMPLE_JOINTS)]


def untrained() -> Controller:
    robot = load_robot("asimo")
    centre = np.concatenate([robot.input_centre, robot.comfort])
    learner = Learner(LearnerConfig(seed=4, epochs=1), input_centre=robot.input_centre, output_centre=centre)
    return Controller.from_learner(learner, joints=robot.joints, robot_toml=robot.toml_text, robot_urdf=robot.urdf_text)


def test_learning_while_serving_is_training_on_the_same_stream(log: Path) -> None:
    replay = Replay([log], Schedule(epochs=1, phases=(("learn", 1),)))
    trainer = Trainer(LearnerConfig(seed=4))
    InProcess({"learner": trainer}).deliver(replay.offer(), replay.stream)
    served = ServedController(untrained(), config=ServingConfig(learn=True, washout_steps=0))
    commands = feed(served, ticks(log))
    assert len(commands) == 41
    assert served.status()["learned_steps"] == 40
    assert state_of(served) == trainer.result()["digest"] == served.controller().digest


def test_the_prediction_sent_is_the_prediction_scored(controller: Controller, log: Path, samples: Samples) -> None:
    served = ServedController(controller, config=ServingConfig(learn=True))
    commands = feed(served, ticks(log))
    learner = controller.learner()
    learner.washout(samples.targets[0], steps=WASHOUT_STEPS)
    following = np.vstack([samples.targets[1:], served.controller().pending])
    scored = learner.step(samples.targets, np.column_stack([following, samples.joints]), learning=True)[:, 6:]
    sent = np.array([positions(command) for command in commands[:-1]])
    assert sent.tobytes() == np.clip(scored, samples.robot.lower, samples.robot.upper).tobytes()
    assert state_of(served) == state_digest(learner.state(), served.controller().pending)
    assert 0.0 < served.status()["hand_error_cm"] < 100.0


def test_a_tick_that_lacks_its_joints_is_as_if_it_had_not_been(controller: Controller, log: Path) -> None:
    records = ticks(log)
    stamps = [decode_as(PoseStamped, r.data).stamp_ns for r in records if r.topic == LEFT_TARGET]
    served, other = (ServedController(controller, config=ServingConfig(learn=True)) for _ in range(2))
    lost = [r for r in records if not (r.topic == SAMPLE_JOINTS and stamp_of(r) == stamps[7])]
    without = [r for r in records if stamp_of(r) != stamps[7]]
    assert len(feed(served, lost)) == len(feed(other, without)) == 40
    assert state_of(served) == state_of(other)
    assert served.status()["refused"] == {"no partner": 2}


def stamp_of(record: RecordedMessage) -> int:
    if record.topic == SAMPLE_JOINTS:
        return decode_as(JointState, record.data).stamp_ns
    return decode_as(PoseStamped, record.data).stamp_ns


def test_joints_that_cannot_be_learned_from_are_refused(controller: Controller) -> None:
    served = ServedController(controller, config=ServingConfig(learn=True))
    names, comfort = controller.joints, load_robot("asimo").comfort
    for wrong in (
        JointState(1, names[1:], comfort[1:]),
        JointState(1, names, comfort * np.nan),
        JointState(1, names, comfort + 1e9),
    ):
        assert served.take(record(SAMPLE_JOINTS, wrong)) is None
    assert served.status()["refused"] == {"wrong joints": 1, "not finite": 1, "out of range": 1}


def test_a_phase_that_is_not_for_learning_teaches_nothing(controller: Controller, log: Path) -> None:
    served = ServedController(controller, config=ServingConfig(learn=True))
    feed(served, [record(SESSION_PHASE, Phase("run", 0, 0, "evaluate", "log").to_message()), *ticks(log)])
    assert served.status()["learned_steps"] == 0
    weights = "reservoir_output_weights"
    assert np.array_equal(served.controller().state[weights], controller.state[weights])


def test_serving_alone_never_changes_what_was_learned(controller: Controller, samples: Samples) -> None:
    served = ServedController(controller)
    feed(served, [m for k, u in enumerate(samples.targets) for m in pair(k, u)])
    now = served.controller()
    adapted = [name for name in controller.state if name.endswith("weights") or name in "ab"]
    assert all(np.array_equal(now.state[name], controller.state[name]) for name in adapted)
    assert now.provenance["served_from"] == controller.digest


def test_a_controller_for_other_joints_than_its_robots_is_refused(controller: Controller) -> None:
    with pytest.raises(ControllerError, match="the joints of asimo"):
        ServedController(replace(controller, joints=tuple(reversed(controller.joints))))


@pytest.mark.parametrize("wrong", [{"washout_steps": -1}, {"outside_m": 0.0}, {"outside_m": float("nan")}])
def test_a_configuration_out_of_range_is_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ConfigError, match="washout_steps"):
        ServingConfig(**wrong)


def test_other_topics_are_passed_over(controller: Controller) -> None:
    served = ServedController(controller)
    assert served.take(record(JOINT_COMMANDS, JointState(1, ("a",), np.zeros(1)))) is None


def measured(stamp_ns: int, position: np.ndarray, joints: tuple[str, ...]) -> RecordedMessage:
    return record(JOINT_STATES, JointState(stamp_ns, joints, position))


def at(time_ns: int, records: list[RecordedMessage]) -> list[RecordedMessage]:
    return [message._replace(log_time_ns=time_ns) for message in records]


def test_with_a_largest_speed_a_controller_starts_from_where_the_robot_is(
    controller: Controller, samples: Samples
) -> None:
    """No command before the joints are known; then from them, no joint faster than it may be; counts stay right."""
    served, free = (ServedController(controller, config=ServingConfig(max_speed=speed)) for speed in (0.5, None))
    step_ns, start = 20_000_000, samples.robot.comfort + 0.01
    assert feed(served, pair(1)) == []
    assert served.status()["refused"] == {"not measured": 1}
    assert feed(served, [measured(99, start, controller.joints)]) == []
    ticks = [at(2 + k * step_ns, pair(2 + k * step_ns, samples.targets[0])) for k in range(300)]
    commands = [positions(command) for tick in ticks for command in feed(served, tick)]
    asked = [positions(command) for tick in ticks for command in feed(free, tick)]
    assert len(commands) == len(asked) == len(ticks)
    assert commands[0].tobytes() == start.tobytes()
    assert (np.abs(np.diff(commands, axis=0)) <= 0.5 * step_ns * 1e-9 * (1 + 1e-9)).all()
    assert commands[-1].tobytes() == asked[-1].tobytes()  # it has arrived
    assert served.status()["accepted"] == len(ticks)
    held_back = [one.tobytes() != other.tobytes() for one, other in zip(commands, asked, strict=True)]
    assert served.status()["limited"] == sum(held_back) > 0
    assert served.status()["digest"] == free.status()["digest"]  # what was learned moves on as ever
    assert feed(served, [measured(99, start[:-1], controller.joints[:-1])]) == []
    assert served.status()["refused"] == {"not measured": 1, "wrong joints": 1}


def test_joints_on_their_way_are_none_that_a_target_commands(controller: Controller) -> None:
    with pytest.raises(ConfigError, match="--max-speed: with --learn"):
        ServedController(controller, config=ServingConfig(learn=True, max_speed=0.5))
