"""`view` and `--view`: what was recorded and learned is what is shown, and showing it changes and reaches nothing."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import typer
from episodes import PERIOD_NS, write_episode
from processes import reenact, start
from rerun.chunk import RrdReader
from rerun_server import entities, rerun_server, rows
from sockets import listening

from pipeline.cli import app as cli
from pipeline.cli.logs import view as viewing
from pipeline.evaluation.trials import evaluate_motion
from pipeline.learner.controller import Controller
from pipeline.learner.rules.forward_inverse.config import ForwardInverseConfig
from pipeline.learner.rules.reservoir.config import LearnerConfig
from pipeline.robot.config import load_robot
from pipeline.robot.kinematics import Kinematics
from pipeline.samples.pairs import read_samples
from pipeline.training.trainer import train, train_on
from pipeline.views.learning import LearningView, ViewedTrainer
from pipeline.views.live import LiveView
from pipeline.views.view import view_controller, view_log
from recorders.cdr.codec import decode
from recorders.errors import ConfigError, LogError, MotionError, ReenactError, WireError
from recorders.messages.message_types import Float64MultiArray, JointState, Message, PoseStamped
from recorders.messages.topics import JOINT_COMMANDS, LEARNER_ERROR, LEFT_TARGET, RIGHT_TARGET, SAMPLE_JOINTS
from recorders.reading.reader import LogReader
from recorders.rerun_scene.recording import Destination
from recorders.wire.loopback import free_endpoint
from recorders.writing.writer import LogWriter
from replay.sources.schedule import Schedule
from replay.sources.scheduled import Replay

SAMPLES, EPOCHS = 24, 3


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_episode(tmp_path_factory.mktemp("log") / "circles.mcap", samples=SAMPLES)


@pytest.fixture(scope="module")
def controller(log: Path) -> Path:
    trainer = train([log], schedule=Schedule(epochs=EPOCHS), config=LearnerConfig(seed=1))
    trainer.controller().save(path := log.with_name("controller.npz"))
    return path


@pytest.fixture(scope="module")
def viewed_log(log: Path) -> Path:
    view_log(log, Destination(path := log.with_name("log.rrd")))
    return path


@pytest.fixture(scope="module")
def viewed_controller(controller: Path) -> Path:
    view_controller(controller, Destination(path := controller.with_name("controller.rrd")))
    return path


# from file


def test_a_log_is_shown_with_the_joints_that_were_recorded(log: Path, viewed_log: Path) -> None:
    shown = np.array(rows(viewed_log, "/joints", "Scalars:scalars"))
    np.testing.assert_array_equal(shown[1:], read_samples(log).joints)  # the first posture belongs to no step


def test_the_errors_shown_are_those_of_the_samples(log: Path, viewed_log: Path) -> None:
    samples = read_samples(log)
    reached = Kinematics(samples.robot).hands_along(samples.joints)
    expected_cm = 100.0 * np.linalg.norm(reached - samples.targets.reshape(-1, 2, 3), axis=2)
    for hand, side in enumerate(("left", "right")):
        found = np.array(rows(viewed_log, f"/error/{side}", "Scalars:scalars"))[:, 0]
        np.testing.assert_allclose(found, expected_cm[:, hand], rtol=1e-12)


def test_hands_are_drawn_from_behind_the_robot(log: Path, viewed_log: Path) -> None:
    left, right = (
        np.array(rows(viewed_log, f"/frontal/{hand}/target", "Points2D:positions"))[:, 0] for hand in ("left", "right")
    )
    assert left[:, 0].max() < 0.0 < right[:, 0].min()  # the left hand on the left
    heights_cm = 100.0 * read_samples(log).targets[:, 2]
    np.testing.assert_allclose(left[1:, 1], -heights_cm, atol=1e-4)  # pictures count downwards


def test_joints_stand_between_their_limits(log: Path, viewed_log: Path) -> None:
    robot = load_robot("asimo")
    shown = np.array(rows(viewed_log, "/limits/now", "Points2D:positions"))  # (T, n, 2)
    share = (read_samples(log).joints - robot.lower) / (robot.upper - robot.lower)
    np.testing.assert_allclose(shown[1:, :, 0], 200.0 * share - 100.0, atol=1e-4)
    assert rows(viewed_log, "/limits/names", "Points2D:labels", static=True) == [list(robot.joints)]


def test_both_recordings_have_a_layout_of_their_own(viewed_log: Path, viewed_controller: Path) -> None:
    stores = [RrdReader(path).blueprints() for path in (viewed_log, viewed_controller)]
    assert [[store.application_id for store in found] for found in stores] == [["reenact log"], ["reenact controller"]]


def test_a_controller_is_shown_on_a_motion_with_its_network(controller: Path, viewed_controller: Path) -> None:
    trial = evaluate_motion(Controller.load(controller), "circles")
    np.testing.assert_array_equal(rows(viewed_controller, "/joints", "Scalars:scalars"), trial.joints)
    (errors,) = rows(viewed_controller, "/network/errors", "BarChart:values", static=True)
    assert json.dumps(errors).count(".") >= EPOCHS
    found = entities(viewed_controller)
    assert {"/network/a", "/network/b", "/network/weights", "/reservoir/activity"} <= found


def test_parts_of_a_controllers_commands_are_shown_where_its_rule_has_them(
    log: Path, viewed_controller: Path, tmp_path: Path
) -> None:
    config = ForwardInverseConfig(degree=1)
    trained = train([log], schedule=config.schedule(), config=config, pairs="commanded").controller()
    trained.save(tmp_path / "c.npz")
    view_controller(tmp_path / "c.npz", Destination(path := tmp_path / "c.rrd"))
    expected = evaluate_motion(trained, "circles").deviations
    assert expected is not None
    np.testing.assert_allclose(rows(path, "/parts/curves/1", "Scalars:scalars"), expected[:, :1] * 100.0, rtol=1e-12)
    ((lines,),) = rows(path, "/parts/lines", "TextDocument:text", static=True)
    assert [line.split(":")[0] for line in lines.split("\n")] == ["inverse", "forward left", "forward right"]
    assert "/parts/lines" not in entities(viewed_controller)


def test_commands_are_compared_with_the_target_that_they_answer(tmp_path: Path) -> None:
    """The log of a served controller has no measured joints; and a learner may have told its errors."""
    robot = load_robot("asimo")
    attachments = {"robot.urdf": robot.urdf_text.encode(), "robot.toml": robot.toml_text.encode()}
    hands = Kinematics(robot).hands(robot.comfort)
    with LogWriter(tmp_path / "served.mcap", manifest={}, attachments=attachments) as writer:
        for stamp, lift in ((0, 0.03), (100_000_000, 0.05)):
            for topic, hand in ((LEFT_TARGET, hands[0]), (RIGHT_TARGET, hands[1])):
                writer.write(topic, PoseStamped(stamp, hand + np.array([0.0, 0.0, lift])), log_time_ns=stamp)
            writer.write(JOINT_COMMANDS, JointState(stamp, robot.joints, robot.comfort), log_time_ns=stamp)
        writer.write(LEARNER_ERROR, Float64MultiArray(np.array([0.02, 0.01])), log_time_ns=200_000_000)
    view_log(tmp_path / "served.mcap", Destination(path := tmp_path / "x.rrd"))
    np.testing.assert_allclose(rows(path, "/error/left", "Scalars:scalars"), [[3.0], [5.0]], rtol=1e-9)
    np.testing.assert_allclose(rows(path, "/learning/error/right", "Scalars:scalars"), [[1.0]], rtol=1e-12)


def at_log_times(log: Path, path: Path, log_times_ns: list[int]) -> Path:
    """Write the ticks of a log anew, each at a log time of its own."""
    reader = LogReader(log)
    attachments = {name: reader.attachment(name) for name in ("robot.urdf", "robot.toml")}
    with LogWriter(path, manifest={"kind": "test"}, attachments=attachments) as writer:
        for number, record in enumerate(reader):
            message = decode(record.type, record.data)
            writer.write(record.topic, message, log_time_ns=log_times_ns[number // 3])
    return path


@pytest.mark.parametrize(
    ("first_ns", "steps_ns"),
    [
        (2**64 - 2**35, [2 * PERIOD_NS + 1] * SAMPLES),
        (2**63 - 2 * PERIOD_NS, [PERIOD_NS] * SAMPLES),
        (1_700_000_000_000_000_129, [PERIOD_NS] * SAMPLES),
        (1_700_000_000_000_000_129, [PERIOD_NS] * 9 + [-3 * PERIOD_NS + 7] + [PERIOD_NS] * (SAMPLES - 10)),
        (0, [2**63 - 1] + [0] * (SAMPLES - 1)),
    ],
    ids=["near 2^64", "across 2^63", "today", "stepped back", "as far as a time line reaches"],
)
def test_every_posture_stands_at_its_log_time_to_the_nanosecond(
    log: Path, tmp_path: Path, first_ns: int, steps_ns: list[int]
) -> None:
    times_ns = [first_ns + sum(steps_ns[:k]) for k in range(SAMPLES + 1)]
    moved = at_log_times(log, tmp_path / "moved.mcap", times_ns)
    assert view_log(moved, Destination(path := tmp_path / "moved.rrd")) == SAMPLES + 1
    start_ns = next(iter(LogReader(moved))).log_time_ns
    assert sorted(shown_at(path, "/joints")) == sorted(time_ns - start_ns for time_ns in times_ns)


@pytest.mark.parametrize("jump_ns", [2**63, 2**64 - 2**35], ids=["2^63", "round the end of 64 bits"])
def test_log_times_further_apart_than_a_time_line_reaches_are_one_line(
    log: Path, tmp_path: Path, jump_ns: int, capfd: pytest.CaptureFixture[str]
) -> None:
    times_ns = [jump_ns + tick for tick in range(9)] + list(range(SAMPLES - 8))
    moved = at_log_times(log, tmp_path / "moved.mcap", times_ns)
    with pytest.raises(SystemExit) as end:
        cli.main(["view", str(moved), "--save", str(tmp_path / "moved.rrd")])
    assert end.value.code == 2
    error = capfd.readouterr().err
    assert error.startswith(f"reenact: {moved}: /")
    assert "expected messages within 9223372036 s of the first" in error
    assert error.count("\n") == 1
    assert not (tmp_path / "moved.rrd").exists()


def shown_at(path: Path, entity: str) -> list[int]:
    """Times [ns] at which a recording has rows of an entity."""
    chunks = [chunk for chunk in RrdReader(path).stream() if chunk.entity_path == entity and not chunk.is_static]
    columns = [chunk.to_record_batch().column("time") for chunk in chunks]
    return [int(time) for column in columns for time in column.cast("int64").to_pylist()]


def test_the_same_log_has_one_recording_id(log: Path, viewed_log: Path, tmp_path: Path) -> None:
    view_log(log, Destination(again := tmp_path / "again.rrd"))
    ids = {str(RrdReader(path).recordings()[0].recording_id) for path in (viewed_log, again)}
    assert len(ids) == 1


@pytest.mark.parametrize("name", ["icub", "g1", "talos"])
def test_other_robots_are_shown_from_config_alone(name: str, tmp_path: Path) -> None:
    robot = load_robot(name)
    attachments = {"robot.urdf": robot.urdf_text.encode(), "robot.toml": robot.toml_text.encode()}
    hands = Kinematics(robot).hands(robot.comfort)
    with LogWriter(tmp_path / "x.mcap", manifest={}, attachments=attachments) as writer:
        for topic, hand in ((LEFT_TARGET, hands[0]), (RIGHT_TARGET, hands[1])):
            writer.write(topic, PoseStamped(0, hand), log_time_ns=0)
        writer.write(JOINT_COMMANDS, JointState(0, robot.joints, robot.comfort), log_time_ns=0)
    path = tmp_path / "x.rrd"
    assert view_log(tmp_path / "x.mcap", Destination(path)) == 1
    np.testing.assert_allclose(rows(path, "/error/left", "Scalars:scalars"), [[0.0]], atol=1e-12)
    left, right = (np.array(rows(path, f"/frontal/{hand}/target", "Points2D:positions")) for hand in ("left", "right"))
    assert left[0, 0, 0] < right[0, 0, 0]


# bad input


def view(*arguments: object) -> None:
    app = typer.Typer()
    app.command()(viewing.view)
    app(list(map(str, arguments)), standalone_mode=False)


def without_robot(log: Path) -> list[object]:
    return [write_episode(log.with_name("bare.mcap"), samples=2, attachments={})]


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        (lambda log: ["missing.mcap"], ConfigError, "missing.mcap: no such file; expected a log or a controller"),
        (lambda log: [log, "--motion", "eight"], ConfigError, "--motion is for controllers"),
        (lambda log: [log, "--save", "x.rrd", "--viewer", "x"], ConfigError, "one of --save and --viewer"),
        (lambda log: [log, "--viewer", "http://127.0.0.1:9876"], ConfigError, "expected the URL of a viewer"),
        (lambda log: [log, "--viewer", "rerun+http://127.0.0.1:1/proxy"], WireError, "expected a viewer at"),
        (without_robot, ConfigError, "carries no robot; give one with --robot"),
        (lambda log: [log, "--save", "x.rrd", "--map", f"{LEFT_TARGET}=/other"], LogError, "give foreign names with"),
    ],
)
def test_bad_input_is_one_line(
    log: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    arguments: Callable[[Path], list[object]],
    error: type[ReenactError],
    message: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    given = arguments(log)
    with pytest.raises(error, match=message) as raised:
        view(*given, *(["--save", "y.rrd"] if len(given) == 1 else []))
    assert "\n" not in str(raised.value)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("topic", "changed", "complaint"),
    [
        (SAMPLE_JOINTS, np.nan, "/sample/joint_states: expected a finite position for joint hip_height, found nan"),
        (LEFT_TARGET, 1e300, "expected finite numbers within 1e\\+09 of zero in targets"),
    ],
)
def test_numbers_that_cannot_be_drawn_are_one_line(
    tmp_path: Path, topic: str, changed: float, complaint: str, recwarn: pytest.WarningsRecorder
) -> None:
    def change(tick: int, of: str, message: Message) -> list[tuple[str, Message]]:
        if of == topic and isinstance(message, JointState | PoseStamped):
            message = replace(message, position=np.array([changed, *message.position[1:]]))
        return [(of, message)]

    with pytest.raises(MotionError, match=complaint):
        view(write_episode(tmp_path / "log.mcap", samples=3, change=change), "--save", tmp_path / "x.rrd")
    assert not recwarn.list
    assert not (tmp_path / "x.rrd").exists()


def test_without_a_display_the_way_out_is_named(log: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(ConfigError, match=r"cannot open a window: .* --save FILE\.rrd"):
        view(log)


# live


def learn_and_replay(log: Path, folder: Path, *options: str) -> tuple[str, str]:
    """Run a learner over Zenoh, and return the digest that it comes to and what it says."""
    endpoint = free_endpoint()
    learner = start("learn", "--listen", endpoint, "--out", "x.npz", "--json", *options, cwd=folder)
    try:
        assert learner.stderr is not None
        said = ""
        while "waits for" not in said:
            line = learner.stderr.readline()
            assert line, said
            said += line
        arguments = ("--connect", endpoint, "--epochs", EPOCHS, "--wait", 120, "--json")
        replay = reenact("replay", log, *arguments, cwd=folder)
        assert replay.returncode == 0, replay.stderr
        printed, complaints = learner.communicate(timeout=120)
    finally:
        learner.kill()
    return str(json.loads(printed)["digest"]), said + complaints


@pytest.fixture(scope="module")
def learned(log: Path, controller: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("live")
    with rerun_server(folder) as server:
        assert listening(server.pid) == {f"tcp 0100007F:{int(server.url.split(':')[2].split('/')[0]):04X}"}
        digest, _ = learn_and_replay(log, folder, "--seed", "1", "--viewer", server.url)
        assert digest == Controller.load(controller).digest  # of the same training, unseen
    return server.path


def test_a_learner_is_shown_epoch_by_epoch(controller: Path, learned: Path) -> None:
    told = Controller.load(controller).provenance["errors_cm"]
    left, right = (rows(learned, f"/learning/error/{hand}", "Scalars:scalars") for hand in ("left", "right"))
    np.testing.assert_allclose((np.array(left) + right)[:, 0] / 2.0, told, rtol=1e-12)


def test_the_drift_shown_ends_where_the_controller_is(controller: Path, learned: Path) -> None:
    state = Controller.load(controller).state
    for name in ("a", "b"):
        mean, spread = state[name].mean(), state[name].std()
        last = rows(learned, f"/drift/{name}", "Scalars:scalars")[-1]
        np.testing.assert_allclose(last, [mean, mean - spread, mean + spread], rtol=1e-12)
    assert len(rows(learned, "/drift/weights", "Scalars:scalars")) == EPOCHS
    assert {"/robot/moving", "/limits/now", "/hands/left/reached_path", "/reservoir/activity"} <= entities(learned)


def test_a_viewer_that_is_not_there_stops_nothing(log: Path, controller: Path, tmp_path: Path) -> None:
    digest, said = learn_and_replay(log, tmp_path, "--seed", "1", "--viewer", "rerun+http://127.0.0.1:1/proxy")
    assert digest == Controller.load(controller).digest
    assert "--view: expected a viewer at rerun+http://127.0.0.1:1/proxy, found none" in said


def test_a_viewer_that_ends_in_mid_run_is_one_line(
    log: Path, controller: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr("recorders.rerun_scene.recording._FLUSH_S", 0.1)  # nobody is there to be waited for
    with rerun_server(tmp_path) as server:
        view = LiveView(server.url)
        trainer = ViewedTrainer(LearnerConfig(seed=1), view=LearningView(view))
    train_on(Replay([log], Schedule(epochs=EPOCHS)), trainer)
    view.close()
    view.close()
    assert trainer.result()["digest"] == Controller.load(controller).digest
    (line,) = caplog.messages
    assert line.startswith("--view: the viewer shows no more: ")
