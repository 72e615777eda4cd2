"""The robot as a node: lockstep to the bit, its own rate, refusals that leave it where it is, and a clean end."""

import hashlib
import json
import signal
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import replace
from itertools import pairwise
from subprocess import Popen

import numpy as np
import pytest
import zenoh
from late_subscriber import subscribe
from live import robot, spawn, stop
from numpy.typing import ArrayLike
from waiting import wait_until

from pipeline.robot.config import load_robot
from pipeline.robot.kinematics import Kinematics
from pipeline.robot_node.client import RemoteRobot
from pipeline.robot_node.follower import FollowerConfig
from pipeline.robot_node.node import MAX_WAITING
from pipeline.robot_node.protocol import MAX_COMMAND, RobotStatus, pack_messages, robot_key, unpack_messages
from pipeline.simulation.simulation import Simulation
from recorders.cdr.codec import decode, decode_as, encode
from recorders.errors import ConfigError, ReenactError, WireError
from recorders.messages import topics
from recorders.messages.message_types import Clock, JointState, PoseStamped, String
from recorders.messages.record import RecordedMessage
from recorders.protocol.frames import unpack
from recorders.wire.bounded_queue import ITEM_BYTES, BoundedQueue
from recorders.wire.keys.namespace import message_key
from recorders.wire.loopback import free_endpoint
from recorders.wire.session import SessionConfig, open_session

ASIMO = load_robot("asimo")
PERIOD_NS = 5_000_000
STOPPED_S = 1.0
BLOCK = zenoh.CongestionControl.BLOCK
COMMAND_KEY = robot_key("reenact", "command")
TOPIC_KEY = message_key("reenact", topics.JOINT_COMMANDS)
DESCRIPTION_KEY = message_key("reenact", topics.ROBOT_DESCRIPTION)


@pytest.fixture(scope="module")
def endpoint() -> Iterator[str]:
    """A robot in lockstep that all tests of this module drive, one after the other."""
    where = free_endpoint()
    with robot(where):
        yield where


@pytest.fixture
def session(endpoint: str) -> Iterator[zenoh.Session]:
    with open_session(SessionConfig(connect=(endpoint,))) as opened:
        yield opened


@pytest.fixture
def remote(session: zenoh.Session) -> RemoteRobot:
    return RemoteRobot(session, patience_s=120.0)


def command(stamp_ns: int = 0, q: np.ndarray = ASIMO.comfort, names: tuple[str, ...] = ASIMO.joints) -> JointState:
    return JointState(stamp_ns, names, q)


def ask(session: zenoh.Session, key: str, payload: bytes) -> bytes | str:
    """Return the robot's answer, or why it refused."""
    (reply,) = session.get(key, payload=payload, timeout=120)
    if reply.ok is not None:
        return reply.ok.payload.to_bytes()
    assert reply.err is not None
    return reply.err.payload.to_string()


def order(session: zenoh.Session, *commands: JointState) -> bytes | str:
    return ask(session, COMMAND_KEY, pack_messages(map(encode, commands)))


def status(session: zenoh.Session) -> RobotStatus:
    answer = ask(session, robot_key("reenact", "status"), b"")
    assert isinstance(answer, bytes)
    return RobotStatus.from_json(answer)


def moves(count: int) -> list[np.ndarray]:
    """Commands that swing about the comfort posture."""
    return [ASIMO.comfort + 0.05 * np.sin(0.1 * k) for k in range(count)]


def test_in_lockstep_it_is_where_the_simulation_is_to_the_bit(remote: RemoteRobot) -> None:
    here = Simulation(ASIMO)
    start = ASIMO.comfort + 0.01
    for driven in (here, remote):
        driven.reset(start)
    for posture in moves(60):
        here.advance(posture, PERIOD_NS)
        remote.advance(posture, PERIOD_NS)
        assert remote.time_ns == here.time_ns
        np.testing.assert_array_equal(remote.positions, here.positions)
        np.testing.assert_array_equal(remote.velocities, here.velocities)
        np.testing.assert_array_equal(remote.hands(), here.hands())
    np.testing.assert_allclose(remote.hands(), Kinematics(ASIMO).hands(here.positions), rtol=0, atol=2e-6)


def test_who_comes_late_is_told_which_robot_it_is_and_where(session: zenoh.Session, remote: RemoteRobot) -> None:
    remote.reset(ASIMO.comfort)
    remote.advance(ASIMO.comfort, PERIOD_NS)
    remote.wait()
    late = RemoteRobot(session)
    assert late.time_ns == PERIOD_NS
    np.testing.assert_array_equal(late.positions, remote.positions)
    assert remote.robot.urdf_text == ASIMO.urdf_text
    assert remote.robot.toml_text == ASIMO.toml_text


def test_a_command_again_changes_nothing(session: zenoh.Session, remote: RemoteRobot) -> None:
    remote.reset(ASIMO.comfort)
    first = order(session, command(0))
    assert order(session, command(0)) == first
    assert isinstance(first, bytes)
    assert decode_as(JointState, first).stamp_ns == PERIOD_NS == status(session).time_ns


def test_joints_are_found_by_name(session: zenoh.Session, remote: RemoteRobot) -> None:
    posture = moves(9)[-1]
    remote.reset(ASIMO.comfort)
    remote.advance(posture, PERIOD_NS)
    expected = remote.positions
    shuffled = np.random.default_rng(0).permutation(len(ASIMO.joints))
    remote.reset(ASIMO.comfort)
    answer = order(session, command(0, posture[shuffled], tuple(ASIMO.joints[k] for k in shuffled)))
    assert isinstance(answer, bytes)
    np.testing.assert_array_equal(decode_as(JointState, answer).position, expected)


def test_it_keeps_within_its_joints_limits(remote: RemoteRobot) -> None:
    remote.reset(ASIMO.comfort)
    remote.advance(np.full(len(ASIMO.joints), 1e300), 200 * PERIOD_NS)
    assert (remote.positions < ASIMO.upper + 0.02).all()


REFUSED = {
    "nan": (encode(command(0, np.full(15, np.nan))), "expected a finite position for joint hip_height, found nan"),
    "ahead": (
        encode(command(5 * PERIOD_NS)),
        "expected stamp 10000000 ns, the robot's time, or one of the last commands again, found stamp 25000000 ns",
    ),
    "past": (
        encode(command(0, ASIMO.comfort + 0.01)),
        "found stamp 0 ns; is someone else driving it? For a controller's commands, with stamps of their own, "
        "start the robot with --real-time",
    ),
    "another robot's joints": (encode(JointState(0, ("a", "b"), np.zeros(2))), "no joint hip_height"),
    "a joint too many": (
        encode(command(0, np.zeros(16), (*ASIMO.joints, "tail"))),
        "'asimo' has no joint tail; it has hip_height",
    ),
    "another type": (encode(String("stand up")), "JointState"),
    "random bytes": (bytes(range(256)), ""),
    "too much": (bytes(MAX_COMMAND + 1), f"expected commands of at most {MAX_COMMAND} bytes"),
    "nothing": (b"", ""),
}


@pytest.mark.parametrize("case", REFUSED)
def test_a_wrong_command_is_refused_and_the_robot_stays(session: zenoh.Session, remote: RemoteRobot, case: str) -> None:
    payload, expected = REFUSED[case]
    remote.reset(ASIMO.comfort)
    remote.advance(ASIMO.comfort, 2 * PERIOD_NS)
    remote.wait()
    before = status(session)
    reason = ask(session, COMMAND_KEY, pack_messages([payload]))
    assert isinstance(reason, str)
    assert expected in reason
    assert "\n" not in reason
    session.put(TOPIC_KEY, payload, congestion_control=BLOCK)
    remote.advance(ASIMO.comfort, PERIOD_NS)  # it goes on from where it was
    remote.wait()
    after = status(session)
    assert after == replace(before, time_ns=3 * PERIOD_NS, commands=before.commands + 1, refused=before.refused + 2)


@pytest.mark.parametrize("payload", [b"", b"\x05", bytes(3), b"\xff\xff\xff\xff", pack_messages([b"12345"])[:-1]])
def test_a_question_that_holds_no_commands_is_refused(session: zenoh.Session, payload: bytes) -> None:
    reason = ask(session, COMMAND_KEY, payload)
    assert isinstance(reason, str)
    assert reason.startswith("expected commands")


def test_commands_are_unpacked_as_they_were_packed() -> None:
    for commands in ([b"a"], [b"", b"bc", bytes(1000)]):
        assert unpack_messages(pack_messages(commands)) == commands


def test_a_wrong_posture_to_stand_in_is_refused(session: zenoh.Session, remote: RemoteRobot) -> None:
    remote.advance(ASIMO.comfort, PERIOD_NS)
    remote.wait()
    with pytest.raises(WireError, match="the robot refused: expected a finite position"):
        remote.reset(np.full(15, np.inf))
    assert status(session).time_ns == remote.time_ns > 0


@pytest.mark.parametrize("periods", [1, 2])
def test_a_driver_notices_another(remote: RemoteRobot, session: zenoh.Session, periods: int) -> None:
    remote.reset(ASIMO.comfort)
    other = RemoteRobot(session)
    other.advance(ASIMO.comfort, periods * PERIOD_NS)
    other.wait()
    remote.advance(ASIMO.comfort + 0.01, PERIOD_NS)
    with pytest.raises(WireError, match="found stamp 0 ns; is someone else driving it"):
        remote.wait()


def test_a_driver_who_says_what_another_has_said_notices_by_the_time(
    remote: RemoteRobot, session: zenoh.Session
) -> None:
    remote.reset(ASIMO.comfort)
    other = RemoteRobot(session)
    other.advance(ASIMO.comfort, 2 * PERIOD_NS)
    other.wait()
    remote.advance(ASIMO.comfort, PERIOD_NS)
    with pytest.raises(WireError, match=f"expected its time to be {PERIOD_NS} ns, found {2 * PERIOD_NS} ns"):
        remote.wait()


@pytest.mark.parametrize("unsaid", [range(0), range(20, 40), range(200)], ids=["all", "some", "none"])
def test_commands_go_out_together_and_each_counts(session: zenoh.Session, remote: RemoteRobot, unsaid: range) -> None:
    """More of them than fit in one query, whatever the topic has said of them before."""
    here = Simulation(ASIMO)
    for driven in (here, remote):
        driven.reset(ASIMO.comfort)
    before = status(session).commands
    postures = moves(200)
    for k, posture in enumerate(postures):
        here.advance(posture, PERIOD_NS)
        if k not in unsaid:
            session.put(TOPIC_KEY, encode(command(k * PERIOD_NS, posture)))
        remote.advance(posture, PERIOD_NS)
    assert remote.time_ns == here.time_ns
    np.testing.assert_array_equal(remote.positions, here.positions)
    assert status(session).commands == before + 200


def test_a_duration_that_is_no_multiple_of_the_period_is_refused(remote: RemoteRobot) -> None:
    with pytest.raises(ConfigError, match="multiples of that, found 7 ns"):
        remote.advance(ASIMO.comfort, 7)


def test_it_says_its_state_at_its_own_rate(session: zenoh.Session, remote: RemoteRobot) -> None:
    heard: list[RecordedMessage] = []

    def hear(sample: zenoh.Sample) -> None:
        topic = "/" + str(sample.key_expr).removeprefix("reenact/")
        assert sample.attachment is not None
        heard.extend(unpack(topic, sample.payload.to_bytes(), sample.attachment.to_bytes()).messages)

    with session.declare_subscriber("reenact/**", hear):
        status(session)  # the robot answers this after it has met the subscriber
        remote.reset(ASIMO.comfort)
        for posture in moves(40):
            remote.advance(posture, PERIOD_NS)
        remote.wait()
        wait_until(lambda: len(heard) >= 11 * 5)
    due = list(range(0, 40 * PERIOD_NS + 1, 20_000_000))
    for topic in (topics.CLOCK, topics.JOINT_STATES, topics.TF, topics.LEFT_MEASURED, topics.RIGHT_MEASURED):
        records = [record for record in heard if record.topic == topic]
        assert [record.log_time_ns for record in records] == due
        assert np.diff([record.sequence for record in records]).tolist() == [1] * (len(due) - 1)
        for record in records:
            message = decode(record.type, record.data)
            if isinstance(message, Clock):
                assert message.clock_ns == record.log_time_ns
            elif isinstance(message, JointState | PoseStamped):
                assert message.stamp_ns == record.log_time_ns


def got_description(subscriber: Popen[str]) -> bool:
    """Whether a subscriber got the description, as ROS 2 encodes it, and got it once."""
    out, _ = subscriber.communicate(timeout=120)
    found = json.loads(out.splitlines()[-1])
    expected = encode(String(ASIMO.urdf_text))
    return found == {
        "sha256": [hashlib.sha256(expected).hexdigest()],
        "encoding": ["application/cdr;std_msgs/msg/String"],
    }


def test_a_subscriber_that_comes_late_gets_the_description(endpoint: str) -> None:
    with subscribe(endpoint, DESCRIPTION_KEY) as late:
        assert got_description(late)


def test_a_subscriber_that_was_there_first_gets_the_description() -> None:
    """The robot connects to where the subscriber is, as a client: a session that has no timestamps."""
    from pipeline.robot_node.node import RobotNode

    endpoint = free_endpoint()
    with open_session(SessionConfig(listen=(endpoint,))), subscribe(endpoint, DESCRIPTION_KEY) as early:
        assert early.stdout is not None
        assert early.stdout.readline() == "ready\n"
        with open_session(SessionConfig(connect=(endpoint,))) as session, RobotNode(Simulation(ASIMO), session):
            assert got_description(early)


def test_two_robots_in_one_namespace_are_one_too_many(endpoint: str) -> None:
    from pipeline.robot_node.node import RobotNode

    with (
        open_session(SessionConfig(connect=(endpoint,))) as session,
        pytest.raises(WireError, match="a robot stands in namespace 'reenact' already"),
        RobotNode(Simulation(ASIMO), session),
    ):
        pass


def test_no_robot_is_one_clear_line() -> None:
    endpoint = free_endpoint()
    with (
        open_session(SessionConfig(listen=(endpoint,))) as session,
        pytest.raises(WireError, match=r"no robot answered in namespace 'reenact' within 0\.3 s; start one"),
    ):
        RemoteRobot(session, wait_s=0.3)


def test_a_robot_that_is_gone_is_noticed() -> None:
    endpoint = free_endpoint()
    with robot(endpoint) as process, open_session(SessionConfig(connect=(endpoint,))) as session:
        remote = RemoteRobot(session, patience_s=1.0)
        process.kill()
        remote.advance(ASIMO.comfort, PERIOD_NS)
        with pytest.raises(
            WireError, match="'asimo' has not answered for 1 s; what it was sent after its time 0 ns is unconfirmed"
        ):
            remote.wait()


def alive(session: zenoh.Session) -> bool:
    return any(reply.ok is not None for reply in session.liveliness().get("reenact/@robot/alive", timeout=120.0))


@pytest.mark.parametrize(("signum", "exit_status"), [(signal.SIGTERM, 143), (signal.SIGINT, 130)])
def test_a_signal_ends_it_cleanly_and_it_has_named_each_reason_once(signum: signal.Signals, exit_status: int) -> None:
    endpoint = free_endpoint()
    with robot(endpoint) as process, open_session(SessionConfig(connect=(endpoint,))) as session:
        assert alive(session)
        for _ in range(5):
            session.put(TOPIC_KEY, encode(command(0, np.full(15, np.nan))), congestion_control=BLOCK)
        assert status(session).refused == 5
        complaints = stop(process, signum)
    assert process.returncode == exit_status
    assert complaints == ["refused a command: expected a finite position for joint hip_height, found nan"]


class Over(Exception):
    """Ends a robot that would go on for ever."""


class Busy(Simulation):
    """Takes its time over the first command, until it may go on."""

    def __init__(self) -> None:
        super().__init__(ASIMO)
        self.begun, self.may_go_on, self.is_over = threading.Event(), threading.Event(), False

    def advance(self, q_command: ArrayLike, duration_ns: int) -> None:
        self.begun.set()
        assert self.may_go_on.wait(120)
        if self.is_over:
            raise Over
        super().advance(q_command, duration_ns)


def test_a_flood_is_one_line_and_the_robot_goes_on(caplog: pytest.LogCaptureFixture) -> None:
    """While it is busy with the first of a hundred commands, far more comes than it has room for."""
    from pipeline.robot_node.node import RobotNode

    endpoint, backend = free_endpoint(), Busy()
    with (
        open_session(SessionConfig(listen=(endpoint,))) as here,
        open_session(SessionConfig(connect=(endpoint,))) as session,
        RobotNode(backend, here) as node,
        ThreadPoolExecutor() as pool,
        ExitStack() as stack,
    ):
        running = pool.submit(node.run)
        stack.callback(end, backend, session)  # or it would outlive a test that fails
        long = [encode(command(k * PERIOD_NS)) for k in range(100)]
        answers = session.get(COMMAND_KEY, payload=pack_messages(long), timeout=120.0)
        assert backend.begun.wait(120)
        with session.declare_publisher(TOPIC_KEY, congestion_control=BLOCK) as flood:
            for k in range(10 * MAX_WAITING):
                flood.put(encode(command((1000 + k) * PERIOD_NS)))
        assert ask(session, DESCRIPTION_KEY, b"")  # answered on the thread that reads: it has read all before
        backend.may_go_on.set()
        assert [reply.ok is not None for reply in answers] == [True]
        remote = RemoteRobot(session)
        for posture in moves(20):
            remote.advance(posture, PERIOD_NS)
        remote.wait()
        found = status(session)
        complaints = list(caplog.messages)
        end(backend, session)
        assert isinstance(running.exception(timeout=120), Over)
    assert (found.time_ns, found.commands) == (120 * PERIOD_NS, 120)
    assert found.refused > 0
    floods = [line for line in complaints if "flood" in line]
    assert floods == ["a flood: dropped commands and questions, as more than 1024 of them wait"]
    assert len(complaints) == 2, complaints  # and one for those that were handled, and refused


def end(backend: Busy, session: zenoh.Session) -> None:
    """End a robot with its next command."""
    backend.is_over = True
    backend.may_go_on.set()
    session.put(TOPIC_KEY, encode(command(backend.time_ns)), congestion_control=BLOCK)


def test_an_inbox_drops_what_it_has_no_room_for_and_counts_it() -> None:
    inbox: BoundedQueue[int] = BoundedQueue(limit=MAX_WAITING * ITEM_BYTES)
    for k in range(MAX_WAITING + 7):
        inbox.put(k, 0)
    assert (inbox.take_dropped(), inbox.take_dropped()) == (7, 0)
    assert [inbox.get(0.0) for _ in range(MAX_WAITING + 1)] == [*range(MAX_WAITING), None]


def test_in_real_time_it_keeps_its_rate_and_says_what_it_could_not_keep() -> None:
    """A process that is stopped for a while loses that time: its own time goes on where it was, at its own rate."""
    endpoint, stamps = free_endpoint(), []

    def hear(sample: zenoh.Sample) -> None:
        stamps.append(decode_as(Clock, sample.payload.to_bytes()).clock_ns)

    with (
        robot(endpoint, real_time=True, rate_hz=25.0) as process,
        open_session(SessionConfig(connect=(endpoint,))) as session,
        session.declare_subscriber(message_key("reenact", topics.CLOCK), hear),
    ):
        began_s, before = time.monotonic(), status(session)
        wait_for(process, session, before.time_ns + 300_000_000)
        process.send_signal(signal.SIGSTOP)
        time.sleep(STOPPED_S)
        process.send_signal(signal.SIGCONT)
        wait_for(process, session, status(session).time_ns + 300_000_000)
        after, took_s = status(session), time.monotonic() - began_s
        wait_until(lambda: len(stamps) >= 10)
        complaints = stop(process)
    slipped_s = after.slipped_s - before.slipped_s
    moved_s = (after.time_ns - before.time_ns) / 1e9
    assert slipped_s > STOPPED_S / 2
    assert moved_s + slipped_s < took_s + 2 * PERIOD_NS / 1e9  # it never hurries
    assert np.diff(stamps).tolist() == [40_000_000] * (len(stamps) - 1)
    assert complaints
    assert all(line.startswith("time slips: ") for line in complaints)
    slips_s = [float(line.removeprefix("time slips: ").split()[0]) for line in complaints]
    assert all(
        later >= 2 * earlier - 0.16 for earlier, later in pairwise(slips_s)
    )  # again when doubled, but for rounding


def wait_for(process: Popen[str], session: zenoh.Session, time_ns: int) -> None:
    """Wait until the robot's time has come to `time_ns`."""
    began_s = time.monotonic()
    while status(session).time_ns < time_ns:
        assert process.poll() is None
        assert time.monotonic() < began_s + 120.0
        time.sleep(0.01)


def test_in_real_time_it_goes_on_by_itself_and_holds_the_latest_command() -> None:
    endpoint = free_endpoint()
    with robot(endpoint, real_time=True) as process, open_session(SessionConfig(connect=(endpoint,))) as session:
        remote = RemoteRobot(session)
        assert remote.status.real_time
        began_s = time.monotonic()
        remote.reset(ASIMO.comfort)
        wait_for(process, session, 300_000_000)
        assert time.monotonic() - began_s > 0.29  # never faster than the clock on the wall
        goal = ASIMO.comfort + 0.05
        session.put(TOPIC_KEY, encode(command(0, goal)), congestion_control=BLOCK)
        wait_for(process, session, status(session).time_ns + 500_000_000)
        remote.advance(goal, PERIOD_NS)
        np.testing.assert_allclose(remote.positions, goal, atol=5e-3)


def test_bad_settings_are_refused() -> None:
    for bad in ({"rate_hz": 0.0}, {"rate_hz": 300.0}, {"rate_hz": float("nan")}, {"period_ns": 0}):
        with pytest.raises(ConfigError):
            FollowerConfig(**bad)
    with spawn("robot", listen=[free_endpoint()], rate_hz=1e6) as process:
        _, complaints = process.communicate(timeout=120)
    assert process.returncode == 2
    assert complaints == "reenact: rate: expected 0.01 to 200 Hz, found 1e+06\n"


@pytest.mark.parametrize("data", [b"", b"[]", b"{}", b"[" * 100_000, b'{"robot": 1}'])
def test_a_status_that_is_none_is_refused(data: bytes) -> None:
    with pytest.raises(ReenactError, match="expected the status of a robot"):
        RobotStatus.from_json(data)
