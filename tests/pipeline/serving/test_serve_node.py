"""`reenact serve` in a process of its own: who may send what, what comes back, and what is left when it ends."""

import json
import os
import queue
import resource
import signal
import subprocess
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zenoh
from episodes import write_episode
from here import reenact_here
from processes import complaint, start, wait_for_line, zenoh_pools
from small_inverse import asked, hands_at, measured, postures, taught
from unfinished import so_far
from waiting import wait_until

from pipeline.evaluation.errors import predicted_joints
from pipeline.learner.controller import Controller
from pipeline.learner.rules.reservoir.config import LearnerConfig
from pipeline.learner.state import state_digest
from pipeline.robot_node.protocol import RobotStatus, robot_key
from pipeline.samples.pairs import Samples, read_samples
from pipeline.serving.config import ServingConfig
from pipeline.serving.served_controller import ServedController
from pipeline.training.trainer import train
from recorders.cdr.codec import decode_as, encode
from recorders.cdr.types.joint_trajectory import JointTrajectory
from recorders.errors import WireError
from recorders.messages.message_types import Float64MultiArray, JointState, PoseStamped
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import (
    CONTROLLER_DEVIATION,
    JOINT_COMMANDS,
    JOINT_STATES,
    LEARNER_TOPICS,
    LEFT_TARGET,
    RIGHT_TARGET,
    SAMPLE_JOINTS,
)
from recorders.protocol.frames import NO_RUN, Frame, FrameType, pack, unpack
from recorders.reading.reader import LogReader
from recorders.wire.keys.namespace import message_key
from recorders.wire.loopback import free_endpoint
from recorders.wire.session import SessionConfig, open_session
from replay.sources.live import live_offer
from replay.sources.schedule import Schedule
from replay.transports.sender_config import SenderConfig
from replay.transports.zenoh import ZenohTransport

WAIT_S = 120.0


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_episode(tmp_path_factory.mktemp("serve") / "log.mcap", samples=30)


@pytest.fixture(scope="module")
def controller(log: Path) -> Controller:
    return train([log], schedule=Schedule(epochs=3), config=LearnerConfig(seed=2)).controller()


@pytest.fixture(scope="module")
def samples(log: Path) -> Samples:
    return read_samples(log)


class Watcher:
    """Somebody else on the network: puts targets, hears commands, sees who is alive, asks for the status."""

    def __init__(self, session: zenoh.Session, endpoint: str, *, namespace: str = "reenact") -> None:
        self.endpoint = endpoint
        self._session = session
        self._namespace = namespace
        self._commands: queue.SimpleQueue[zenoh.Sample] = queue.SimpleQueue()
        self._subscriber = session.declare_subscriber(message_key(namespace, JOINT_COMMANDS), self._commands.put)

    def await_alive(self, name: str = "controller") -> None:
        wait_until(lambda: self.alive() == [f"{self._namespace}/@controller/{name}/alive"])

    def alive(self) -> list[str]:
        replies = self._session.liveliness().get(f"{self._namespace}/@controller/*/alive", timeout=2.0)
        return [str(reply.ok.key_expr) for reply in replies if reply.ok is not None]

    def status(self, name: str = "controller") -> dict[str, Any]:
        (reply,) = self._session.get(f"{self._namespace}/@controller/{name}/status", timeout=WAIT_S)
        assert reply.ok is not None
        return dict(json.loads(reply.ok.payload.to_bytes()))

    def status_where(self, **expected: object) -> dict[str, Any]:
        """Ask until the status says what is expected, for messages take their time."""
        deadline = time.monotonic() + WAIT_S
        while True:
            status = self.status()
            if all(status[name] == value for name, value in expected.items()) or time.monotonic() > deadline:
                assert {name: status[name] for name in expected} == expected
                return status
            time.sleep(0.05)

    def delete(self, topic: str) -> None:
        self._session.delete(message_key(self._namespace, topic))

    def put(self, record: RecordedMessage, *, attached: bool = True, encoding: str | None = None) -> None:
        payload, attachment = pack(Frame(FrameType.MESSAGE, NO_RUN, NO_RUN, record.sequence, (record,)))
        self._session.put(
            message_key(self._namespace, record.topic),
            payload,
            attachment=attachment if attached else None,
            encoding=encoding,
            congestion_control=zenoh.CongestionControl.BLOCK,
        )

    def command(self) -> tuple[int, np.ndarray, RecordedMessage]:
        """Return stamp, positions and record of the next command."""
        sample = self._commands.get(timeout=WAIT_S)
        assert sample.attachment is not None
        assert str(sample.encoding) == f"application/cdr;{JointState.TYPE}"
        (record,) = unpack(JOINT_COMMANDS, sample.payload.to_bytes(), sample.attachment.to_bytes()).messages
        message = decode_as(JointState, record.data)
        return message.stamp_ns, message.position, record

    def listen(self, topic: str) -> "queue.SimpleQueue[zenoh.Sample]":
        """Return a queue of what comes on a topic from now on."""
        samples: queue.SimpleQueue[zenoh.Sample] = queue.SimpleQueue()
        self._others = self._session.declare_subscriber(message_key(self._namespace, topic), samples.put)
        return samples

    def heard_nothing(self) -> bool:
        return self._commands.empty()


@contextmanager
def serving(
    controller: Controller,
    folder: Path,
    *options: object,
    name: str = "controller",
    namespace: str = "reenact",
    listens: bool = True,
) -> Iterator[tuple[Watcher, subprocess.Popen[str]]]:
    """Serve a controller in an empty folder, with somebody connected, either way, who has seen it alive."""
    endpoint, path = free_endpoint(), folder / "controller.npz"
    controller.save(path)
    role = "--listen" if listens else "--connect"
    arguments = ("serve", path, role, endpoint, "--name", name, "--namespace", namespace, "--json", *options)
    session_config = SessionConfig(**{"connect" if listens else "listen": (endpoint,)}, wait_s=WAIT_S)
    with start(*arguments, cwd=folder) as process:
        with open_session(session_config) as session:
            watcher = Watcher(session, endpoint, namespace=namespace)
            watcher.await_alive(name)
            yield watcher, process
        process.kill()


def stop(process: subprocess.Popen[str], signum: signal.Signals = signal.SIGTERM) -> tuple[dict[str, Any], str]:
    """Return the summary and what was said, once a signal has ended the process."""
    process.send_signal(signum)
    summary, said = process.communicate(timeout=WAIT_S)
    assert process.returncode == {signal.SIGTERM: 143, signal.SIGINT: 130}[signum], said
    assert "reenact: " not in said  # the summary says it all
    return json.loads(summary), said


def stamp_of_attachment(sample: zenoh.Sample) -> int:
    """Return the stamp under which a sample without one of its own came [ns]."""
    assert sample.attachment is not None
    (message,) = unpack(CONTROLLER_DEVIATION, sample.payload.to_bytes(), sample.attachment.to_bytes()).messages
    return message.log_time_ns


def targets(stamp_ns: int, u: Iterable[float], *, sequence: int = 0) -> list[RecordedMessage]:
    hands = np.reshape(np.array(u), (2, 3))
    return [
        RecordedMessage(topic, PoseStamped.TYPE, encode(PoseStamped(stamp_ns, hand)), sequence, stamp_ns)
        for topic, hand in zip((LEFT_TARGET, RIGHT_TARGET), hands, strict=True)
    ]


@pytest.mark.parametrize(("attached", "listens"), [(True, True), (False, False)])
def test_a_motion_is_answered_with_the_postures_of_its_evaluation(
    controller: Controller, samples: Samples, tmp_path: Path, attached: bool, listens: bool
) -> None:
    expected = predicted_joints(controller.learner(), samples.targets, 15)
    with serving(controller, tmp_path, name="anna", namespace="lab/asimo", listens=listens) as (watcher, process):
        assert ("rx" in zenoh_pools(process.pid)) == listens  # threads that read alone, where messages are passed on
        for k, u in enumerate(samples.targets):
            for record in targets(k * 10**8, u, sequence=k):
                watcher.put(record, attached=attached)
            stamp, positions, record = watcher.command()
            assert (stamp, record.sequence, record.log_time_ns) == (k * 10**8, k, k * 10**8)
            limited = np.clip(expected[k], samples.robot.lower, samples.robot.upper)
            assert positions.tobytes() == limited.tobytes()
        status = watcher.status("anna")
        last, tick = status, len(samples.targets)
        while not last["rate_hz"] > 0:  # of the last two seconds
            exchange(watcher, targets(tick * 10**8, samples.targets[0]))
            last, tick = watcher.status("anna"), tick + 1
        summary, said = stop(process)
    assert status["accepted"] == status["commands"] == len(samples.targets)
    assert status["refused"] == {}
    assert status["controller"] == controller.digest
    assert 0 < status["latency_us"]["p50"] <= status["latency_us"]["p99"] <= status["latency_us"]["max"]
    assert summary["name"] == "anna"
    assert summary["digest"] == last["digest"]
    (line,) = said.splitlines()
    way = "at" if listens else "through"
    assert line == f"anna serves lab/asimo/joint_commands {way} {watcher.endpoint}"


@pytest.mark.parametrize("listens", [True, False])
def test_after_a_stall_all_that_has_come_is_answered(
    controller: Controller, samples: Samples, tmp_path: Path, listens: bool
) -> None:
    """A thread that reads on must not keep the commands from leaving: there is room for some 1400 of them."""
    with serving(controller, tmp_path, listens=listens) as (watcher, process):
        process.send_signal(signal.SIGSTOP)
        for stamp in range(1000):
            for record in targets(stamp, samples.targets[stamp % len(samples.targets)]):
                watcher.put(record)
        process.send_signal(signal.SIGCONT)
        assert [watcher.command()[0] for _ in range(1000)] == list(range(1000))
        stop(process)


@pytest.mark.parametrize("listens", [True, False])
def test_what_is_no_target_is_refused_and_the_rest_is_served_on(
    controller: Controller, samples: Samples, tmp_path: Path, listens: bool
) -> None:
    u = samples.targets[0]
    left, right = targets(20, u)
    nan, _ = targets(30, [np.nan, *u[1:]])
    joints = RecordedMessage(LEFT_TARGET, "", encode(JointState(40, ("a",), np.zeros(1))), 0, 0)
    with serving(controller, tmp_path, listens=listens) as (watcher, process):
        for record in targets(10, u):
            watcher.put(record)
        watcher.command()
        digest = watcher.status()["digest"]
        for record, encoding in zip(targets(15, u), (f"application/cdr;{JointState.TYPE}", None), strict=True):
            watcher.put(record, encoding=encoding)  # a pose in all but its name
        watcher.put(targets(10, u)[0])
        watcher.put(nan)
        watcher.put(joints, encoding=f"application/cdr;{JointState.TYPE}")
        watcher.put(joints)
        watcher.put(left._replace(data=os.urandom(300)), attached=False)
        watcher.put(left._replace(data=bytes(100_000_000)), attached=False)
        watcher.put(left._replace(topic="/session/phase", data=os.urandom(50)))
        refused = {"wrong type": 2, "stale": 1, "not finite": 1, "undecodable": 3, "too large": 1}
        status = watcher.status_where(refused=refused)
        assert watcher.heard_nothing()
        assert status["digest"] == digest
        watcher.put(left)
        watcher.delete(LEFT_TARGET)  # says nothing, and is no partner
        for record in targets(50, u):
            watcher.put(record)
        assert watcher.command()[0] == 50
        watcher.status_where(refused=refused | {"no partner": 2}, accepted=2)
        watcher.put(right)
        watcher.status_where(refused=refused | {"no partner": 2, "stale": 2})
        _, said = stop(process)
    lines = [line.partition(": ")[0] for line in said.splitlines()]
    (serves,) = (line for line in lines if not line.startswith("refused, "))  # before or after the first of the others
    assert serves.startswith("controller serves ")
    lines.remove(serves)
    assert lines == [f"refused, {reason}" for reason in (*refused, "no partner")]


@pytest.mark.parametrize("signum", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_leaves_a_complete_log_of_targets_and_commands(
    controller: Controller, samples: Samples, tmp_path: Path, signum: int
) -> None:
    with serving(controller, tmp_path, "--record", "served.mcap") as (watcher, process):
        answers = []
        for k, u in enumerate(samples.targets):
            for record in targets(k, u, sequence=100 + k):
                watcher.put(record)
            answers.append(watcher.command()[2].data)
        watcher.put(targets(10**6, samples.targets[0])[0])  # half a tick: not answered, not in the log
        summary, _ = stop(process, signum)
    reader = LogReader(tmp_path / "served.mcap")
    assert reader.manifest["complete"] is True
    assert reader.manifest["controller"] == controller.digest
    records = list(reader)
    assert [record.data for record in records if record.topic == JOINT_COMMANDS] == answers
    assert [record.sequence for record in records if record.topic == LEFT_TARGET] == [
        100 + k for k in range(len(samples.targets))
    ]
    assert summary["recorded"] == len(records) == 3 * len(samples.targets)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["controller.npz", "served.mcap"]


def test_commands_that_nobody_subscribes_to_are_named(controller: Controller, samples: Samples, tmp_path: Path) -> None:
    with serving(controller, tmp_path, "--command-type", "float64-array") as (watcher, process):
        for record in targets(1, samples.targets[0]):
            watcher.put(record)
        assert "nobody subscribes to reenact/forward_position_controller/commands" in wait_for_line(process, "nobody")
        stop(process)


def test_a_trajectory_controller_gets_what_moves_the_robot_slowly(
    controller: Controller, samples: Samples, tmp_path: Path
) -> None:
    """Nothing before its joints are known, then where it stands, then on the way; and the log has the same bytes."""
    topic, start = "/arm/joint_trajectory", samples.robot.comfort + 0.01
    joints = RecordedMessage(JOINT_STATES, JointState.TYPE, encode(JointState(1, controller.joints, start)), 0, 1)
    options = ("--command-type", "trajectory", "--command-topic", topic, "--reach-in", "0.02", "--max-speed", "0.5")
    with serving(controller, tmp_path, *options, "--record", "served.mcap") as (watcher, process):
        commands = watcher.listen(topic)
        for record in targets(1, samples.targets[0]):
            watcher.put(record)
        watcher.status_where(refused={"not measured": 1})
        watcher.put(joints)
        for stamp in (2, 20_000_002):
            for record in targets(stamp, samples.targets[0]):
                watcher.put(record)
        answers = [commands.get(timeout=WAIT_S) for _ in range(2)]
        summary, _ = stop(process)
    assert {str(answer.encoding) for answer in answers} == {f"application/cdr;{JointTrajectory.TYPE}"}
    payloads = [answer.payload.to_bytes() for answer in answers]
    first, second = (decode_as(JointTrajectory, payload) for payload in payloads)
    assert first.points[0].positions.tobytes() == start.tobytes()
    assert first.points[0].time_from_start_ns == 20_000_000
    assert np.abs(second.points[0].positions - start).max() <= 0.01 * (1 + 1e-9)
    assert summary["commands"] == 2
    assert [record.data for record in LogReader(tmp_path / "served.mcap") if record.topic == topic] == payloads


def test_learning_over_zenoh_is_learning_in_process_and_its_log_trains(
    controller: Controller, log: Path, tmp_path: Path
) -> None:
    records = [record for record in LogReader(log) if record.topic in {topic.name for topic in LEARNER_TOPICS}]
    expected = ServedController(controller, config=ServingConfig(learn=True))
    for record in records:
        expected.take(record)
    with serving(controller, tmp_path, "--learn", "--record", "s.mcap", "--out", "learned.npz") as (watcher, process):
        for record in records:
            watcher.put(record)
        status = watcher.status_where(accepted=31, learned_steps=30)
        summary, _ = stop(process)
    assert status["digest"] == summary["digest"] == expected.status()["digest"]
    learned = Controller.load(tmp_path / "learned.npz")
    assert learned.digest == summary["digest"] != controller.digest
    assert learned.provenance["served_from"] == controller.digest
    recorded = [record for record in LogReader(tmp_path / "s.mcap") if record.topic != JOINT_COMMANDS]
    assert sorted(r.data for r in recorded) == sorted(r.data for r in records)
    assert np.array_equal(read_samples(tmp_path / "s.mcap").targets, read_samples(log).targets)
    assert SAMPLE_JOINTS in {record.topic for record in recorded}


def test_what_was_reached_is_learned_over_zenoh_and_its_log_trains_to_the_same_state(tmp_path: Path) -> None:
    """Deviations come in the order of the commands; what was learned is written, and can be gone on from."""
    before = taught()
    joints = postures(12, seed=1)
    hands = hands_at(joints) + 0.002
    with serving(before, tmp_path, "--learn", "--record", "s.mcap", "--out", "learned.npz") as (watcher, process):
        deviations = watcher.listen(CONTROLLER_DEVIATION)
        for k in range(12):
            for message in (*asked(2 * k, hands[k]), *measured(2 * k + 1, joints[k], hands[k])):
                watcher.put(message)
            assert watcher.command()[0] == 2 * k
        watcher.status_where(accepted=12, learned_steps=12)
        stamps = [stamp_of_attachment(deviations.get(timeout=WAIT_S)) for _ in range(12)]
        summary, _ = stop(process)
    assert stamps == [2 * k for k in range(12)]
    assert all(value > 0.0 for value in summary["deviation_cm"].values())
    learned, recorded = Controller.load(tmp_path / "learned.npz"), read_samples(tmp_path / "s.mcap", pairs="reached")
    learner = before.adaptive().learner()
    learner.step(recorded.targets, np.concatenate([recorded.targets, recorded.joints], axis=1), learning=True)
    assert len(recorded.targets) == 12
    assert summary["digest"] == learned.digest == state_digest(learner.state(), np.empty(0)) != before.digest
    assert ServedController(learned, config=ServingConfig(learn=True)).status()["digest"] == learned.digest
    shown = [
        decode_as(Float64MultiArray, r.data) for r in LogReader(tmp_path / "s.mcap") if r.topic == CONTROLLER_DEVIATION
    ]
    assert [message.data.shape for message in shown] == [(2,)] * 12


def test_one_that_was_to_learn_and_could_not_writes_no_controller(
    controller: Controller, samples: Samples, tmp_path: Path
) -> None:
    with serving(controller, tmp_path, "--learn", "--out", "learned.npz") as (watcher, process):
        for stamp in range(3):  # targets without joints
            for record in targets(stamp, samples.targets[0]):
                watcher.put(record)
        process.send_signal(signal.SIGTERM)
        summary, said = process.communicate(timeout=WAIT_S)
    assert process.returncode == 2
    assert json.loads(summary)["learned_steps"] == 0
    assert said.splitlines()[-1].startswith("reenact: nothing was learned, and no controller written: --learn: ")
    assert not (tmp_path / "learned.npz").exists()


def test_a_log_that_cannot_be_written_on_stops_no_command(
    controller: Controller, samples: Samples, tmp_path: Path
) -> None:
    u = samples.targets[0]
    with serving(controller, tmp_path, "--record", "served.mcap") as (watcher, process):
        for stamp in range(20):
            exchange(watcher, targets(stamp, u))
        watcher.status_where(recorded=60, recording=True)
        part = tmp_path / "served.mcap.part"
        wait_until(lambda: len(so_far(part)) >= 60)  # it is on the disk 0.1 s later
        resource.prlimit(process.pid, resource.RLIMIT_FSIZE, (part.stat().st_size,) * 2)  # as if the disk were full
        for stamp in range(20, 600):
            exchange(watcher, targets(stamp, u))
        status = watcher.status_where(recording=False)
        exchange(watcher, targets(600, u))
        process.send_signal(signal.SIGTERM)
        summary, said = process.communicate(timeout=WAIT_S)
    assert process.returncode == 2  # it was asked to record, and could not
    assert status["commands"] == 600
    assert json.loads(summary)["commands"] == 601
    (line,) = [line for line in said.splitlines() if line.endswith("; nothing more is recorded, all else goes on")]
    assert "served.mcap" in line
    assert said.splitlines()[-1].startswith("reenact: ")
    kept = so_far(part)
    assert [record.topic for record in kept[:3]] == [LEFT_TARGET, RIGHT_TARGET, JOINT_COMMANDS]
    assert len(kept) >= 60


def exchange(watcher: Watcher, records: list[RecordedMessage]) -> None:
    """Put the targets of a tick and await their command."""
    for record in records:
        watcher.put(record)
    assert watcher.command()[0] == decode_as(PoseStamped, records[0].data).stamp_ns


def test_a_second_controller_in_a_namespace_is_refused_unless_told_otherwise(
    controller: Controller, samples: Samples, tmp_path: Path
) -> None:
    controller.save(tmp_path / "c.npz")
    with serving(controller, tmp_path, name="anna") as (watcher, process):
        second = ("serve", "c.npz", "--connect", watcher.endpoint)
        line = complaint(reenact_here(*second, "--record", "s.mcap", cwd=tmp_path))
        assert line == (
            "reenact: controller 'anna' serves in namespace 'reenact' already: end it, choose a --namespace, "
            "or allow both with --allow-multiple"
        )
        line = complaint(reenact_here(*second, "--name", "anna", "--allow-multiple", cwd=tmp_path))
        assert line == (
            "reenact: controller 'anna' serves in namespace 'reenact' already: end it, choose a --namespace, "
            "or choose another --name"
        )
        line = complaint(reenact_here(*second, "--name", "anna", cwd=tmp_path))
        assert line.endswith("choose a --namespace, or allow both with --allow-multiple and another --name")
        with start(*second, "--name", "berta", "--allow-multiple", "--json", cwd=tmp_path) as beside:
            assert (
                wait_for_line(beside, "serves") == f"berta serves reenact/joint_commands through {watcher.endpoint}\n"
            )
            wait_until(lambda: len(watcher.alive()) == 2)  # whoever sees it may send targets
            for record in targets(1, samples.targets[0]):
                watcher.put(record)
            assert [watcher.command()[0] for _ in range(2)] == [1, 1]
            stop(beside)
        stop(process)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["c.npz", "controller.npz"]


@contextmanager
def robot_status(endpoint: str, *, joints: tuple[str, ...] = ()) -> Iterator[zenoh.Session]:
    """Listen, and answer for a robot in lockstep."""
    status = RobotStatus("berta\x1b", False, 0, 10**8, commands=0, refused=0, slipped_s=0.0, joints=joints).to_json()

    def answer(query: zenoh.Query) -> None:
        with query:
            query.reply(query.key_expr, status)

    with open_session(SessionConfig(listen=(endpoint,))) as session:
        with session.declare_queryable(robot_key("reenact", "status"), answer):
            yield session


def test_a_robot_in_lockstep_is_pointed_out(controller: Controller, tmp_path: Path) -> None:
    controller.save(tmp_path / "c.npz")
    endpoint = free_endpoint()
    with robot_status(endpoint):
        with start("serve", "c.npz", "--connect", endpoint, "--json", cwd=tmp_path) as process:
            assert "targets are stamped with its own time" in wait_for_line(process, "lockstep")
            wait_for_line(process, "controller serves")
            stop(process)


def test_a_robot_with_other_joints_is_refused_by_name(controller: Controller, tmp_path: Path) -> None:
    controller.save(tmp_path / "c.npz")
    endpoint = free_endpoint()
    joints = (*controller.joints[1:], *(f"finger_{k}" for k in range(7)))
    with robot_status(endpoint, joints=joints):
        line = complaint(reenact_here("serve", "c.npz", "--connect", endpoint, "--out", "o.npz", cwd=tmp_path))
    assert line == (
        f"reenact: robot 'berta\\x1b' has other joints than the controller: it lacks {controller.joints[0]}, the "
        "controller lacks finger_0, finger_1, finger_2, finger_3, finger_4 and 2 more; serve a controller of this "
        "robot, or choose its --namespace"
    )
    assert [path.name for path in tmp_path.iterdir()] == ["c.npz"]


def test_a_robot_with_other_joints_that_comes_later_is_warned_of(controller: Controller, tmp_path: Path) -> None:
    controller.save(tmp_path / "c.npz")
    endpoint = free_endpoint()
    with start("serve", "c.npz", "--listen", endpoint, "--json", cwd=tmp_path) as process:
        wait_for_line(process, "controller serves")
        with open_session(SessionConfig(connect=(endpoint,))) as session:
            statuses = [
                RobotStatus("same", True, 0, 10**8, 0, 0, 0.0, joints=controller.joints[::-1]),  # in another order
                RobotStatus("other", True, 0, 10**8, 0, 0, 0.0, joints=controller.joints[:-1]),
            ]
            asked: queue.SimpleQueue[str] = queue.SimpleQueue()
            for status in statuses:
                with ExitStack() as stack:
                    stack.enter_context(
                        session.declare_queryable(robot_key("reenact", "status"), replier(status, asked))
                    )
                    stack.enter_context(session.liveliness().declare_token(robot_key("reenact", "alive")))
                    assert asked.get(timeout=WAIT_S) == status.robot
            line = wait_for_line(process, "has other joints")
        stop(process)
    assert line == (
        f"warning: robot 'other' has other joints than the controller: it lacks {controller.joints[-1]}; "
        "it refuses the commands\n"
    )


def replier(status: RobotStatus, asked: "queue.SimpleQueue[str]") -> Callable[[zenoh.Query], None]:
    def answer(query: zenoh.Query) -> None:
        with query:
            query.reply(query.key_expr, status.to_json())
        asked.put(status.robot)

    return answer


def test_a_paced_replay_that_awaits_the_controller_is_answered_to_the_last_tick(
    controller: Controller, log: Path, tmp_path: Path
) -> None:
    """Whichever of the two is there first."""
    controller.save(tmp_path / "c.npz")
    endpoint = free_endpoint()
    played = ("replay", log, "--play", "--rate", 50, "--await", "anna", "--wait", WAIT_S, "--listen", endpoint)
    with start(*played, "--json", cwd=tmp_path) as replaying:
        with start("serve", "c.npz", "--name", "anna", "--connect", endpoint, "--json", cwd=tmp_path) as serving:
            out, said = replaying.communicate(timeout=2 * WAIT_S)
            stop(serving)
    assert (replaying.returncode, said) == (0, "")
    result = json.loads(out)["consumers"]["anna"]
    assert (result["commands"], result["accepted"], result["refused"]) == (31, 31, {})


def test_a_replay_that_does_not_pace_itself_cannot_await_a_controller(
    controller: Controller, log: Path, tmp_path: Path
) -> None:
    with serving(controller, tmp_path) as (watcher, process):
        there = ("--connect", watcher.endpoint, "--await", "controller")
        assert "pace the replay with --rate" in complaint(reenact_here("replay", log, "--play", *there, cwd=tmp_path))
        assert watcher.heard_nothing()
        stop(process)


@pytest.mark.parametrize(
    ("name", "started"),
    [
        ("controller", "start one with `reenact serve`,"),
        ("learner", "start one with `reenact learn`,"),
        ("recorder", "start one with `reenact record`,"),
        ("anna", "`reenact record --name anna` or `reenact serve --name anna`,"),
    ],
)
def test_when_nobody_comes_the_verb_to_start_is_named(name: str, started: str) -> None:
    with open_session(SessionConfig(listen=(free_endpoint(),))) as session:
        transport = ZenohTransport(session, config=SenderConfig(consumers=(name,), wait_s=0.0))
        with pytest.raises(WireError) as raised:
            transport.deliver(live_offer("0" * 32, epochs=1, robot={}), lambda start: iter(()))
    assert started in str(raised.value)


def test_a_file_that_is_no_controller_is_one_clear_line(tmp_path: Path) -> None:
    (tmp_path / "bad.npz").write_bytes(b"no zip")
    for name in ("bad.npz", "absent.npz"):
        line = complaint(reenact_here("serve", name, "--listen", free_endpoint(), "--record", "s.mcap", cwd=tmp_path))
        assert f"cannot use controller {name}" in line
    assert [path.name for path in tmp_path.iterdir()] == ["bad.npz"]


def test_a_log_that_exists_is_one_clear_line(controller: Controller, log: Path, tmp_path: Path) -> None:
    controller.save(tmp_path / "c.npz")
    line = complaint(reenact_here("serve", "c.npz", "--listen", free_endpoint(), "--record", log, cwd=tmp_path))
    assert f"{log} exists" in line


def test_whoever_watches_sees_the_controller_go(controller: Controller, tmp_path: Path) -> None:
    with serving(controller, tmp_path) as (watcher, process):
        process.kill()
        process.wait(WAIT_S)
        wait_until(lambda: not watcher.alive())
