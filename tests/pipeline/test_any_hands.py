"""A robot of one hand, or of three, be one of them asked for poses, is explored, learned, served and kept as of two."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from more_hands import ONE, THREE, write_motion, write_robot
from processes import start, wait_for_line
from scipy.spatial.transform import Rotation

from pipeline.cli import app
from pipeline.learner.controller import Controller
from pipeline.learner_node.replay_node import replay
from pipeline.robot.coordinates import positions_of, turns_of
from pipeline.samples.pairs import read_samples
from pipeline.serving.config import ServingConfig
from pipeline.serving.served_controller import ServedController
from recorders.cdr.codec import decode_as, encode
from recorders.messages.message_types import PoseStamped
from recorders.messages.topics import SAMPLE_JOINTS, commanded_tick, hand_measured, hand_target
from recorders.reading.reader import LogReader
from recorders.wire.loopback import free_endpoint
from recorders.wire.session import SessionConfig
from recorders.writing.writer import RESERVED, LogWriter
from replay.sources.schedule import Schedule
from replay.sources.scheduled import Replay
from replay.transports.sender_config import SenderConfig

EPOCHS = 2
SAMPLES = 8


def run(*arguments: object) -> int:
    with pytest.raises(SystemExit) as end:
        app.main([str(argument) for argument in arguments])
    return int(end.value.code or 0)


@pytest.fixture(
    scope="module",
    params=[(ONE, ()), (THREE, THREE[-1:])],
    ids=["one hand", "three hands and a pose"],
)
def kind(request: pytest.FixtureRequest) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Names of all hands, and of those that are asked for poses."""
    found: tuple[tuple[str, ...], tuple[str, ...]] = request.param
    return found


@pytest.fixture(scope="module")
def hands(kind: tuple[tuple[str, ...], tuple[str, ...]]) -> tuple[str, ...]:
    return kind[0]


@pytest.fixture(scope="module")
def poses(kind: tuple[tuple[str, ...], tuple[str, ...]]) -> tuple[str, ...]:
    return kind[1]


@pytest.fixture(scope="module")
def work(hands: tuple[str, ...], poses: tuple[str, ...], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the robot, a motion, the log of an exploration, and the controller that was trained from it."""
    folder = tmp_path_factory.mktemp("hands")
    robot = write_robot(folder / "robot", hands, poses=poses)
    motion = write_motion(folder / "motion.csv", robot, samples=SAMPLES)
    assert run("explore", "--robot", robot, "--motion", motion, "--out", folder / "log.mcap") == 0
    training = ("--epochs", EPOCHS, "--seed", 3, "--out", folder / "trained.npz")
    assert run("train", folder / "log.mcap", *training) == 0
    return folder


@pytest.fixture
def result(capsys: pytest.CaptureFixture[str]) -> Any:
    """Run a verb and return what it prints as JSON."""

    def printed(*arguments: object) -> Any:
        capsys.readouterr()
        code = run(*arguments, "--json")
        out, err = capsys.readouterr()
        assert code == 0, err
        return json.loads(out)

    return printed


def move_target(log: Path, topic: str) -> None:
    """Move the fourth message on a topic by a millimetre."""
    reader = LogReader(log)
    attachments = {name: reader.attachment(name) for name in reader.attachments}
    manifest = {key: value for key, value in reader.manifest.items() if key not in RESERVED}
    with LogWriter(log.with_suffix(".new"), manifest=manifest, attachments=attachments) as writer:
        for record in reader.records(file_order=True):
            if record.topic == topic and record.sequence == 3:
                pose = decode_as(PoseStamped, record.data)
                record = record._replace(data=encode(PoseStamped(pose.stamp_ns, pose.position + 1e-3)))
            writer.copy(record)
    log.with_suffix(".new").rename(log)


def per_hand(hands: Sequence[str], *names: str) -> set[str]:
    return {name.format(hand) for hand in hands for name in names}


def test_the_log_and_its_samples_are_of_all_hands(work: Path, hands: tuple[str, ...], poses: tuple[str, ...]) -> None:
    counts = LogReader(work / "log.mcap").counts
    topics = [SAMPLE_JOINTS, *map(hand_target, hands), *map(hand_measured, hands)]
    assert {topic: counts[topic] for topic in topics} == dict.fromkeys(topics, SAMPLES + 1)
    samples = read_samples(work / "log.mcap")
    assert samples.robot.hand_names == hands
    assert samples.targets.shape == (SAMPLES, 3 * len(hands) + 3 * len(poses))
    motion = np.loadtxt(work / "motion.csv", delimiter=",", skiprows=1)
    positions = positions_of(samples.robot, samples.targets).reshape(SAMPLES, -1)
    np.testing.assert_array_equal(positions, motion[:, 1 : 1 + 3 * len(hands)])
    turned = [Rotation.from_rotvec(turns) for turns in turns_of(samples.robot, samples.targets).values()]
    middles = [Rotation.from_quat(hand.orientation) for hand in samples.robot.hands if hand.orientation is not None]
    for place, (turn, middle) in enumerate(zip(turned, middles, strict=True)):
        asked = Rotation.from_quat(motion[:, 1 + 3 * len(hands) + 4 * place :][:, :4])
        assert (turn * middle * asked.inv()).magnitude().max() < 1e-9


def test_learned_over_zenoh_and_from_the_file_is_one_state(work: Path, hands: tuple[str, ...], tmp_path: Path) -> None:
    endpoint, schedule = free_endpoint(), Schedule(epochs=EPOCHS, topics=commanded_tick(hands))
    with start("learn", "--listen", endpoint, "--seed", 3, "--out", "live.npz", "--json", cwd=tmp_path) as learner:
        wait_for_line(learner, "waits for a replay")
        session = SessionConfig(connect=(endpoint,))
        sent = replay(Replay([work / "log.mcap"], schedule), session=session, sender=SenderConfig(wait_s=120.0))
        out, complaints = learner.communicate(timeout=120)
    assert learner.returncode == 0, complaints
    trained = Controller.load(work / "trained.npz")
    assert json.loads(out)["digest"] == sent["consumers"]["learner"]["digest"] == trained.digest
    assert Controller.load(tmp_path / "live.npz").digest == trained.digest


def test_evaluate_names_every_hand(work: Path, hands: tuple[str, ...], poses: tuple[str, ...], result: Any) -> None:
    found = result("evaluate", work / "trained.npz", work / "log.mcap")
    each = per_hand(hands, "{}_cm", "{}_max_cm", "teacher_{}_cm", "linear_{}_cm")
    each |= per_hand(poses, "{}_deg", "{}_max_deg", "teacher_{}_deg", "linear_{}_deg")
    assert found.keys() == {"mean_cm", "max_cm", "samples", "pairs", "teacher_cm", "linear_cm"} | each
    assert found["mean_cm"] == pytest.approx(np.mean([found[f"{hand}_cm"] for hand in hands]))
    assert result("evaluate", work / "trained.npz", "eight")["samples"] == 64


def test_served_it_drives_the_robot(work: Path, result: Any) -> None:
    found = result("evaluate", work / "trained.npz", work / "motion.csv", "--deploy")
    assert 0.0 < found["teacher_cm"] < 3.0
    assert 0.0 < found["learned_cm"] < 30.0


def test_served_it_learns_on(work: Path, hands: tuple[str, ...]) -> None:
    served = ServedController(Controller.load(work / "trained.npz"), config=ServingConfig(learn=True))
    assert served.topics == commanded_tick(hands)
    records = LogReader(work / "log.mcap").records(topics=served.topics)
    commands = [command for record in records if (command := served.take(record)) is not None]
    assert [len(command.answered) for command in commands] == [len(hands) + 1] * (SAMPLES + 1)
    status = served.status()
    assert (status["accepted"], status["learned_steps"], status["refused"]) == (SAMPLES + 1, SAMPLES, {})


def test_it_is_shown(work: Path, tmp_path: Path, result: Any) -> None:
    for source in ("log.mcap", "trained.npz"):
        out = tmp_path / f"{source}.rrd"
        arguments = ("--motion", work / "motion.csv") if source == "trained.npz" else ()
        result("view", work / source, *arguments, "--save", out)
        assert out.stat().st_size > 10_000


def test_a_golden_case_holds_and_names_the_hand_that_moved(
    work: Path, hands: tuple[str, ...], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = ("--name", "hands", "--cases", tmp_path, "--epochs", 1, "--rule", "reservoir", "--physics")
    assert run("golden", "add", work / "log.mcap", *options) == 0
    assert run("golden", "check", tmp_path, "--physics") == 0
    capsys.readouterr()
    log = tmp_path / "hands" / "log.mcap"
    move_target(log, hand_target(hands[-1]))
    assert run("golden", "check", tmp_path) == 1
    assert hand_target(hands[-1]) in capsys.readouterr().out
