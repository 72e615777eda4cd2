"""A live session is one stream: whoever drives, wherever the robot is, and what a learner makes of it is the same."""

import json
import re
import signal
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from subprocess import Popen
from typing import Any

import numpy as np
import pytest
import zenoh
from live import robot, spawn
from processes import start, wait_for_line
from proxy import Proxy
from visitor import await_ready, refusal, visitor

from pipeline.exploration.episode import ExplorationConfig
from pipeline.exploration.live import LiveSession
from pipeline.exploration.self_explorer import SelfExplorer
from pipeline.exploration.source import self_exploration
from pipeline.learner.rules.reservoir.config import LearnerConfig
from pipeline.motions.motion import Motion, read_motion_csv
from pipeline.motions.patterns.eight import eight
from pipeline.robot.config import load_robot
from pipeline.robot_node.client import RemoteRobot
from pipeline.simulation.simulation import Simulation
from pipeline.training.trainer import Trainer
from recorders.cdr.codec import decode, decode_as
from recorders.errors import MotionError, WireError
from recorders.messages import topics
from recorders.messages.message_types import JointState, String
from recorders.messages.phase import EVALUATE, LEARN, WASHOUT, Phase
from recorders.messages.record import RecordedMessage
from recorders.ticks.joiner import Tick, TickJoiner
from recorders.wire.loopback import free_endpoint
from recorders.wire.session import SessionConfig, open_session
from replay.sources.schedule import Schedule
from replay.transports.sender_config import SenderConfig
from replay.transports.zenoh import ZenohTransport

ASIMO = load_robot("asimo")
PHASES = [[WASHOUT, 1], [LEARN, 1], [EVALUATE, 1]]
SCHEDULE = Schedule.from_dict({"epochs": 1, "phases": PHASES})
SAMPLES = 4
PERIOD_NS = 100_000_000
CYCLE_NS = SAMPLES * PERIOD_NS
CUT_S = 1.5
SETTLING = ExplorationConfig(settle_ns=PERIOD_NS)


def short_motion(*, closed: bool) -> Motion:
    """Four samples at 10 Hz, of a small circle of the left hand and a line of the right."""
    angle = 2 * np.pi * np.arange(SAMPLES) / SAMPLES
    circle = 0.02 * np.stack([0 * angle, np.cos(angle), np.sin(angle)], axis=1)
    line = 0.02 * np.stack([0 * angle, np.sin(angle), 0 * angle], axis=1)
    targets = np.stack([ASIMO.centres[0] + circle, ASIMO.centres[1] + line], axis=1)
    return Motion("short", 0.1 * np.arange(SAMPLES), targets, closed)


def live(backend: Simulation | RemoteRobot, motion: Motion, *, seed: int = 3) -> LiveSession:
    session = LiveSession(backend, motion, seed=seed, schedule=SCHEDULE, config=SETTLING)
    session.settle()
    return session


@pytest.fixture(scope="module")
def here() -> list[RecordedMessage]:
    """The stream of a closed motion with the robot in this process."""
    return list(live(Simulation(ASIMO), short_motion(closed=True)).stream_from(0))


@pytest.fixture(scope="module")
def remote() -> Iterator[RemoteRobot]:
    endpoint = free_endpoint()
    with robot(endpoint), open_session(SessionConfig(connect=(endpoint,))) as session:
        yield RemoteRobot(session)


def cycles(stream: list[RecordedMessage]) -> list[tuple[Phase, list[Tick]]]:
    """Phase marker and ticks of each presentation."""
    found: list[tuple[Phase, list[Tick]]] = []
    joiner = TickJoiner()
    for record in stream:
        if record.topic == topics.SESSION_PHASE:
            joiner.finish()
            found.append((Phase.from_message(decode_as(String, record.data)), []))
        elif found:
            found[-1][1].extend(joiner.feed(record))
    joiner.finish()
    return found


def test_a_presentation_is_a_marker_and_t_plus_one_ticks(here: list[RecordedMessage]) -> None:
    motion = short_motion(closed=True)
    assert here[0].topic == topics.SESSION_PHASE
    for number, (phase, ticks) in enumerate(cycles(here)):
        assert (phase.epoch, phase.cycle, phase.phase, phase.log) == (0, number, PHASES[number][0], "")
        first_ns = CYCLE_NS * (1 + number)  # one cycle settles; the last tick and the next first share their instant
        assert [tick.stamp_ns for tick in ticks] == [first_ns + k * PERIOD_NS for k in range(SAMPLES + 1)]
        targets = [np.stack(tick.hands) for tick in ticks]
        np.testing.assert_array_equal(targets, [*motion.targets, motion.targets[0]])


def test_every_command_is_in_the_stream_at_the_time_when_it_takes_effect(here: list[RecordedMessage]) -> None:
    commands = [record for record in here if record.topic == topics.JOINT_COMMANDS]
    stamps = [decode_as(JointState, record.data).stamp_ns for record in commands]
    assert stamps == list(range(CYCLE_NS, 4 * CYCLE_NS, 5_000_000))
    assert stamps == [record.log_time_ns for record in commands]


def test_each_topic_is_numbered_without_a_gap(here: list[RecordedMessage]) -> None:
    for topic in {record.topic for record in here}:
        numbers = [record.sequence for record in here if record.topic == topic]
        assert numbers == list(range(len(numbers)))


def test_joints_of_a_tick_are_those_before_its_target_is_held(here: list[RecordedMessage]) -> None:
    for record in here:
        message = decode(record.type, record.data)
        if record.topic == topics.SAMPLE_JOINTS:
            assert isinstance(message, JointState)
            assert len(message.velocity) == len(message.position) == len(ASIMO.joints)
    (_, first), (_, second), _ = cycles(here)
    np.testing.assert_array_equal(first[-1].joints.position, second[0].joints.position)


def test_two_sessions_with_a_robot_elsewhere_and_one_here_are_equal_to_the_bit(
    here: list[RecordedMessage], remote: RemoteRobot
) -> None:
    for _ in range(2):
        assert list(live(remote, short_motion(closed=True)).stream_from(0)) == here


def test_seed_and_motion_and_schedule_name_the_run() -> None:
    backend, motion = Simulation(ASIMO), short_motion(closed=True)
    runs = [live(backend, motion).offer().run, live(backend, motion, seed=4).offer().run]
    runs += [live(backend, short_motion(closed=False)).offer().run]
    runs += [LiveSession(backend, motion, seed=3, schedule=Schedule(epochs=2)).offer().run]
    assert len(set(runs)) == 4
    assert live(backend, motion).offer().run == runs[0]


def test_an_open_motion_settles_before_each_presentation(remote: RemoteRobot) -> None:
    motion = short_motion(closed=False)
    stream = list(live(remote, motion).stream_from(0))
    found = cycles(stream)
    gap_ns = PERIOD_NS + CYCLE_NS
    assert [ticks[0].stamp_ns for _, ticks in found] == [PERIOD_NS + k * gap_ns for k in range(3)]
    np.testing.assert_array_equal([ticks[-1].hands[1] for _, ticks in found], [motion.targets[:, 1][-1]] * 3)
    numbers = [record.sequence for record in stream if record.topic == topics.JOINT_COMMANDS]
    assert numbers == list(range((3 * gap_ns - PERIOD_NS) // 5_000_000))


def test_a_learner_explores_across_the_network_as_it_does_in_process(remote: RemoteRobot) -> None:
    source = self_exploration(duration_s=4.0)
    digests, streams = set(), []
    for backend in (remote, Simulation(ASIMO)):
        guidance = source.guidance(ASIMO, seed=0)
        session = LiveSession(
            backend,
            source.motion(ASIMO, seed=0),
            seed=0,
            schedule=source.schedule(epochs=1),
            guidance=guidance,
            config=source.config,
        )
        session.settle()
        streams.append(list(session.stream_from(0)))
        assert isinstance(guidance.guide, SelfExplorer)
        digests.add(guidance.guide.digest)
    assert len(digests) == 1
    assert streams[0] == streams[1]


def test_a_live_session_cannot_go_back() -> None:
    session = live(Simulation(ASIMO), short_motion(closed=True))
    with pytest.raises(WireError, match="expected consumers that begin with message 0, found one that wants 7"):
        session.stream_from(7)
    next(session.stream_from(0))
    with pytest.raises(WireError, match="a live session cannot go back"):
        session.stream_from(0)


def test_a_motion_out_of_reach_is_refused_before_the_robot_moves(remote: RemoteRobot) -> None:
    motion = short_motion(closed=True)
    far = Motion("far", motion.times_s, np.add(motion.targets, [[2.0], [0.0]]), closed=True)
    with pytest.raises(MotionError, match="out of reach"):
        LiveSession(remote, far, seed=0, schedule=SCHEDULE)


@pytest.fixture
def csv_motion(tmp_path: Path) -> Path:
    motion = short_motion(closed=False)
    rows = ["t,lx,ly,lz,rx,ry,rz"]
    rows += [
        ",".join(map(repr, [float(t), *left.tolist(), *right.tolist()]))
        for t, left, right in zip(motion.times_s, *motion.targets.swapaxes(0, 1), strict=True)
    ]
    path = tmp_path / "short.csv"
    path.write_text("\n".join(rows))
    return path


def explore(endpoint: str, motion: Path, **options: Any) -> Popen[str]:
    usual = {"seed": 3, "phases": PHASES, "settle_ns": SETTLING.settle_ns, "consumers": []}
    return spawn("explore", connect=endpoint, motion=str(motion), **(usual | options))


def test_a_learner_fed_live_is_the_learner_fed_the_same_messages(csv_motion: Path, tmp_path: Path) -> None:
    expected = Trainer(LearnerConfig(seed=5))
    session = live(Simulation(ASIMO), read_motion_csv(csv_motion, ASIMO.hand_names))
    expected.hello(session.offer())
    expected.consume(session.stream_from(0))

    endpoint = free_endpoint()
    learning = ("learn", "--connect", endpoint, "--out", "c.npz", "--seed", 5, "--json")
    with (
        robot(endpoint),
        start(*learning, cwd=tmp_path) as learner,
        explore(endpoint, csv_motion, consumers=["learner"]) as explorer,
    ):
        explored, complaints = explorer.communicate(timeout=120)
        learned, _ = learner.communicate(timeout=120)
    assert explorer.returncode == 0, complaints
    result = json.loads(explored)
    assert result["ticks"] == session.ticks == 3 * (SAMPLES + 1)
    assert result["messages"] == session.messages
    assert result["run"] == session.offer().run
    assert not result["real_time"]
    for found in (result["consumers"]["learner"], json.loads(learned)):
        assert found["digest"] == expected.result()["digest"]
        assert found["stream_digest"] == expected.result()["stream_digest"]


def test_an_explorer_that_is_stopped_tells_the_learner_and_leaves_the_robot(csv_motion: Path, tmp_path: Path) -> None:
    endpoint = free_endpoint()
    with (
        robot(endpoint) as standing,
        start("learn", "--connect", endpoint, "--out", "c.npz", cwd=tmp_path) as learner,
        explore(endpoint, csv_motion, phases=[[LEARN, 1000]], consumers=["learner"]) as explorer,
    ):
        assert learner.stderr is not None
        while "takes run" not in (line := learner.stderr.readline()):
            assert line
        explorer.send_signal(signal.SIGTERM)
        explorer.communicate(timeout=120)
        _, complaints = learner.communicate(timeout=120)
        assert standing.poll() is None
    assert explorer.returncode == 128 + signal.SIGTERM
    assert learner.returncode == 2
    assert "the sender gave up" in complaints


def test_without_a_robot_it_ends_with_one_line(csv_motion: Path) -> None:
    endpoint = free_endpoint()
    with (
        open_session(SessionConfig(listen=(endpoint,))),
        explore(endpoint, csv_motion, wait_s=0.5) as explorer,
    ):
        _, complaints = explorer.communicate(timeout=120)
    assert explorer.returncode == 2
    assert complaints == (
        "reenact: no robot answered in namespace 'reenact' within 0.5 s; "
        "start one with `reenact robot`, or give its endpoint with --connect\n"
    )


def test_nobody_need_be_awaited(csv_motion: Path) -> None:
    endpoint = free_endpoint()
    with robot(endpoint, real_time=True), explore(endpoint, csv_motion, phases=[[LEARN, 1]]) as explorer:
        explored, complaints = explorer.communicate(timeout=120)
    assert explorer.returncode == 0, complaints
    result = json.loads(explored)
    assert result["consumers"] == {}
    assert result["real_time"]


def explore_with(session: LiveSession, opened: zenoh.Session, ordeal: Callable[[], object]) -> dict[str, Any]:
    """Stream a live session to the learner, let something befall it in the middle, and return its result."""

    def stream_from(index: int) -> Iterator[RecordedMessage]:
        for sent, message in enumerate(session.stream_from(index)):
            if sent == len(PHASES) * SAMPLES * 10:  # in the middle, and of a hold
                ordeal()
            yield message

    return ZenohTransport(opened, config=SenderConfig(batch_size=1, wait_s=120.0)).deliver(session.offer(), stream_from)


@pytest.mark.parametrize("behind_the_cut", ["explorer", "learner"])
def test_a_session_whose_connection_is_cut_goes_on_where_it_was(
    here: list[RecordedMessage], tmp_path: Path, behind_the_cut: str
) -> None:
    expected = Trainer(LearnerConfig(seed=5))
    expected.hello(live(Simulation(ASIMO), short_motion(closed=True)).offer())
    expected.consume(iter(here))
    endpoint = free_endpoint()
    with robot(endpoint), Proxy(endpoint) as proxy:
        ends = {"explorer": endpoint, "learner": endpoint, behind_the_cut: proxy.endpoint}

        def cut() -> None:
            proxy.cut()
            threading.Timer(CUT_S, proxy.restore).start()

        learning = ("learn", "--connect", ends["learner"], "--out", "c.npz", "--seed", 5, "--json")
        with (
            start(*learning, cwd=tmp_path) as learner,
            open_session(SessionConfig(connect=(ends["explorer"],))) as opened,
        ):
            wait_for_line(learner, "waits for a replay")
            remote = live(RemoteRobot(opened), short_motion(closed=True))
            results = explore_with(remote, opened, cut)
            learned, _ = learner.communicate(timeout=120)
    assert remote.messages == len(here)
    for found in (results["learner"], json.loads(learned)):
        assert found["digest"] == expected.result()["digest"]
        assert found["stream_digest"] == expected.result()["stream_digest"]


def test_a_session_whose_connection_stays_cut_ends_at_both_ends_with_what_is_missing() -> None:
    endpoint = free_endpoint()
    with robot(endpoint), Proxy(endpoint) as proxy, visitor("learn", connect=(endpoint,), silence_s=5.0) as learner:
        await_ready(learner)
        with open_session(SessionConfig(connect=(proxy.endpoint,))) as opened:
            session = live(RemoteRobot(opened, patience_s=3.0), short_motion(closed=True))
            gap = r"'asimo' has not answered for 3 s; what it was sent after its time \d+ ns is unconfirmed"
            with pytest.raises(WireError, match=gap):
                explore_with(session, opened, proxy.cut)
        assert re.search(r"the sender fell silent .* before message \d+", refusal(learner))


def test_the_pattern_of_the_paper_is_closed() -> None:
    session = LiveSession(Simulation(ASIMO), eight(ASIMO), seed=0, schedule=Schedule(epochs=1))
    assert session.ticks == 7 * 65
