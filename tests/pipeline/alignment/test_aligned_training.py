"""A log of others trains: its topics are aligned, which says what was used; what cannot be aligned is one line."""

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.writer import Writer
from more_hands import ONE, write_robot
from processes import start, wait_for_line
from sessions import write_foreign
from typer.testing import CliRunner

from pipeline.alignment.aligned_log import AlignedLog
from pipeline.alignment.config import AlignmentConfig
from pipeline.alignment.live import LiveAligner, LiveInputs
from pipeline.cli import app
from pipeline.learner.controller import Controller
from pipeline.robot.config import RobotConfig, load_robot
from pipeline.robot.kinematics import Kinematics
from pipeline.serving.config import ServingConfig
from pipeline.serving.input.served_inputs import ServedInputs
from pipeline.serving.node_config import ServeConfig
from pipeline.serving.served_controller import ServedController
from recorders.cdr.codec import encode
from recorders.cdr.rosbags_types import schema_text
from recorders.containers.opening import open_log
from recorders.conversion.config import ConvertConfig
from recorders.conversion.convert import convert
from recorders.errors import LogError
from recorders.messages.message_types import JointState, PoseStamped, String, TFMessage, TransformStamped
from recorders.messages.phase import LEARN, Phase
from recorders.messages.record import RecordedMessage
from recorders.wire.loopback import free_endpoint
from recorders.writing.writer import LogWriter

MS = 10**6
START = 1_764_000_000 * 10**9
SECONDS = 8
MAPPED = ("--map", "/tracker=/hand/tip/measured")


def run(*arguments: object) -> int:
    with pytest.raises(SystemExit) as end:
        app.main([str(argument) for argument in arguments])
    return int(end.value.code or 0)


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_robot(tmp_path_factory.mktemp("robot") / "robot", ONE)


def posture(robot: RobotConfig, time_s: float) -> Any:
    """Return a posture that goes about the comfortable one, never the same way twice."""
    waves = [math.sin((0.9 + 0.37 * place) * time_s + place) for place in range(len(robot.joints))]
    return robot.comfort + 0.25 * np.array(waves)


def recording(folder: Path, *, tracked: bool = True) -> list[RecordedMessage]:
    """Return what a lab records: joints and a gripper at 100 Hz, a tracker at 30 Hz, each with stamps of its own."""
    robot = load_robot(folder)
    kinematics = Kinematics(robot)
    names = ("gripper", *robot.joints[::-1])
    records = []
    for index in range(SECONDS * 100):
        stamp = START + index * 10 * MS + index % 7 * 30_000
        values = np.array([0.02, *posture(robot, (stamp - START) * 1e-9)[::-1]])
        message = JointState(stamp, names, values, velocity=np.full(len(names), math.nan))
        records.append(RecordedMessage("/joint_states", message.TYPE, encode(message), index, stamp + 2 * MS))
    for index in range(SECONDS * 30 if tracked else 0):
        stamp = START + index * 33_333_333 + 5 * MS
        hand = kinematics.hands(posture(robot, (stamp - START) * 1e-9))[0]
        tracker = PoseStamped(stamp, hand, frame_id="world")
        records.append(RecordedMessage("/tracker", tracker.TYPE, encode(tracker), index, stamp + 9 * MS))
    return sorted(records, key=lambda record: record.log_time_ns)


@pytest.fixture(scope="module")
def log(robot: Path) -> Path:
    return write_foreign(robot.parent / "lab.mcap", recording(robot))


@pytest.fixture
def trained(robot: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Any:
    """Train from a log and return the result, what was noted, and the controller."""

    def train(log: Path, *options: object) -> tuple[Any, str, Controller]:
        out = tmp_path / "out.npz"
        arguments = (
            "--robot",
            robot,
            "--rule",
            "forward-inverse",
            "--epochs",
            1,
            "--out",
            out,
            "--overwrite",
            "--json",
        )
        assert run("train", log, *arguments, *options) == 0
        shown = capsys.readouterr()
        return json.loads(shown.out), shown.err, Controller.load(out)

    return train


def test_ticks_are_those_of_the_tracker(log: Path, trained: Any) -> None:
    result, noted, controller = trained(log, *MAPPED)
    assert result["ticks"] == 2 * SECONDS * 30  # learned, then evaluated
    assert "aligned to 240 ticks at the stamps of /tracker, in 1 episode" in noted
    assert "/joint_states as /sample/joint_states: 800 messages used" in noted
    account = controller.provenance["logs"][0]["alignment"]
    assert account["topics"] == {
        "/tracker": {"as": "/hand/tip/measured", "used": SECONDS * 30},
        "/joint_states": {"as": "/sample/joint_states", "used": SECONDS * 100},
    }
    assert (account["ticks"], account["episodes"], account["tolerance_ns"]) == (240, 1, 100 * MS)


def test_what_is_aligned_may_be_written_and_trained(robot: Path, trained: Any, tmp_path: Path) -> None:
    """The ticks as a log of their own come to the same digests, with the cuts between episodes."""
    log = holed(robot, tmp_path / "holed.mcap")
    options = (*MAPPED, "--tick-rate", 25, "--tolerance", "0.05")
    result, noted, _ = trained(log, *options)
    assert "in 2 episodes; 26 not made" in noted
    config = AlignmentConfig(period_ns=40 * MS, tolerance_ns=50 * MS)
    ticks = AlignedLog(
        open_log(log),
        load_robot(robot),
        config=config,
        renames={"/tracker": "/hand/tip/measured"},
        wanted=("/hand/tip/measured", "/sample/joint_states"),
    )
    attachments = {name: ticks.attachment(name) for name in ticks.attachments}
    with LogWriter(tmp_path / "ticks.mcap", manifest=ticks.manifest, attachments=attachments) as writer:
        for record in ticks:
            writer.copy(record)
    again, noted, _ = trained(tmp_path / "ticks.mcap")
    assert noted == ""
    assert {key: again[key] for key in ("digest", "stream_digest", "ticks")} == {
        key: result[key] for key in ("digest", "stream_digest", "ticks")
    }


def test_raw_joints_and_poses_out_of_an_exploration_are_aligned(
    log: Path, robot: Path, trained: Any, tmp_path: Path
) -> None:
    """A log of ours that was converted without its ticks is aligned as a lab's is, with the robot that it carries."""
    whole, raw = tmp_path / "whole.mcap", tmp_path / "raw.mcap"
    texts = load_robot(robot).toml_text, load_robot(robot).urdf_text
    attachments = {name: text.encode() for name, text in zip(("robot.toml", "robot.urdf"), texts, strict=True)}
    with LogWriter(whole, manifest={"kind": "exploration"}, attachments=attachments) as writer:
        for record in recording(robot):
            writer.copy(record)
        writer.write("/notes", String("x"), log_time_ns=START)
    convert([whole], raw, ConvertConfig(topics=frozenset(["/joint_states", "/tracker"])))
    assert trained(raw, *MAPPED)[0]["digest"] == trained(log, *MAPPED)[0]["digest"]


@pytest.mark.parametrize("period_ns", [None, 20 * MS, 33_333_333])
def test_live_ticks_are_those_of_the_file(robot: Path, period_ns: int | None) -> None:
    """One by one, as they arrive, with a hole, and with latecomers."""
    records = [r for r in recording(robot) if not 3 * 10**9 < r.log_time_ns - START < 4 * 10**9]
    records[200:200] = records[100:120]
    config = AlignmentConfig(period_ns=period_ns, latencies_ns={"/tracker": 7 * MS})
    tick, renames = ("/hand/tip/measured", "/sample/joint_states"), {"/tracker": "/hand/tip/measured"}
    log = write_foreign(robot.parent / "live.mcap", records)
    aligner = LiveAligner(load_robot(robot), config, renames=renames, tick=tick)
    live = [[*aligner.feed(record)] for record in open_log(log).records(file_order=True)]
    made = [message for messages in live for message in messages]
    by_file = AlignedLog(open_log(log), load_robot(robot), config=config, renames=renames, wanted=tick)
    assert made == list(by_file)
    assert max(map(len, live)) == (4 if period_ns == 20 * MS else 2)  # each tick as soon as it is complete
    assert aligner.counts["unaligned"] == 20
    aligner.begin()
    assert [m for r in recording(robot)[:100] for m in aligner.feed(r)]  # stamps start anew


def test_a_frame_is_known_from_its_transform_on_live_as_in_the_file(
    robot: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """Poses in it that came before are dropped and counted."""
    records = changed(recording(robot), "/tracker", lambda pose, stamp: replace(pose, frame_id="cam"))
    static = TFMessage((TransformStamped(0, "world", "cam", np.array((0.0, 0.0, 1.0))),))
    at = [place for place, record in enumerate(records) if record.topic == "/tracker"][19]
    records[at:at] = [RecordedMessage("/tf_static", TFMessage.TYPE, encode(static), 0, records[at].log_time_ns)]
    tick, renames = ("/hand/tip/measured", "/sample/joint_states"), {"/tracker": "/hand/tip/measured"}
    log = write_foreign(robot.parent / "frames.mcap", records)
    aligner = LiveAligner(load_robot(robot), AlignmentConfig(), renames=renames, tick=tick)
    live = [message for record in open_log(log).records(file_order=True) for message in aligner.feed(record)]
    by_file = AlignedLog(open_log(log), load_robot(robot), config=AlignmentConfig(), renames=renames, wanted=tick)
    assert live == list(by_file)
    assert by_file.counts["/hand/tip/measured"] == 240 - 19
    assert aligner.counts["unaligned"] == 19
    assert [record.getMessage() for record in caplog.records] == [
        "/tracker: expected poses in the robot's frame or one that /tf_static joins to it, found cam; give "
        "--frame /tracker=x,y,z,qx,qy,qz,qw"
    ]


@pytest.mark.parametrize("period_ns", [None, 20 * MS])
def test_a_phase_marker_cuts_live_as_in_the_file(robot: Path, period_ns: int | None) -> None:
    records = recording(robot)
    message = Phase("lab", 0, 0, LEARN, log="").to_message()
    marker = RecordedMessage("/session/phase", message.TYPE, encode(message), 0, records[500].log_time_ns)
    tick, renames = ("/hand/tip/measured", "/sample/joint_states"), {"/tracker": "/hand/tip/measured"}
    config = AlignmentConfig(period_ns=period_ns)
    log = write_foreign(robot.parent / "marked.mcap", [*records[:500], marker, *records[500:]])
    inputs = LiveInputs(load_robot(robot), config, renames=renames, tick=tick)
    arrived = open_log(log).records(file_order=True)
    live = [made for record in arrived for made, _ in inputs.feed(record, numbered=True)]
    by_file = AlignedLog(open_log(log), load_robot(robot), config=config, renames=renames, wanted=tick)
    assert [made for made in live if made.topic != "/session/phase"] == list(by_file)
    assert by_file.summary.episodes == 2


def test_a_log_whose_stamps_begin_anew_with_a_phase_is_one_line(robot: Path) -> None:
    records = recording(robot)[:400]
    message = Phase("lab", 0, 0, LEARN, log="").to_message()
    marker = RecordedMessage("/session/phase", message.TYPE, encode(message), 0, records[-1].log_time_ns)
    again = [record._replace(log_time_ns=record.log_time_ns + 10 * 10**9) for record in records]
    log = write_foreign(robot.parent / "again.mcap", [*records, marker, *again])
    tick, renames = ("/hand/tip/measured", "/sample/joint_states"), {"/tracker": "/hand/tip/measured"}
    with pytest.raises(LogError, match="found a clock that began anew; take the times of recording with --clock log"):
        AlignedLog(open_log(log), load_robot(robot), config=AlignmentConfig(), renames=renames, wanted=tick)
    config = AlignmentConfig(clock="log")
    by_log_time = AlignedLog(open_log(log), load_robot(robot), config=config, renames=renames, wanted=tick)
    assert by_log_time.summary.episodes == 2


def test_a_clock_that_begins_anew_is_followed_live(robot: Path) -> None:
    """A simulator is reset: after ten messages of each topic there are ticks again, each as soon as it is complete."""
    records = recording(robot)
    tick, renames = ("/hand/tip/measured", "/sample/joint_states"), {"/tracker": "/hand/tip/measured"}
    for period_ns in (None, 20 * MS):
        config = AlignmentConfig(period_ns=period_ns)
        aligner = LiveAligner(load_robot(robot), config, renames=renames, tick=tick)
        assert [made for record in records for made in aligner.feed(record)]
        again = [[*aligner.feed(record)] for record in anew([*records[:1], *records])[-len(records) // 2 :]]
        first = next(place for place, made in enumerate(again) if made)
        assert first < 50
        assert max(map(len, again)) == (4 if period_ns else 2)


def test_live_takes_the_same_ticks(log: Path, trained: Any) -> None:
    """`--as-live` learns each of them once."""
    result, _, _ = trained(log, *MAPPED, "--tick-rate", 30, "--as-live")
    offline, _, _ = trained(log, *MAPPED, "--tick-rate", 30)
    assert offline["ticks"] == 2 * result["ticks"] > 400


def test_a_controller_is_tried_on_such_a_log(
    log: Path, robot: Path, trained: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Hands as measured are what it is asked for, where there are no targets."""
    trained(log, *MAPPED)
    assert run("evaluate", tmp_path / "out.npz", log, *MAPPED, "--json") == 0
    shown = capsys.readouterr()
    assert "aligned to 240 ticks at the stamps of /tracker" in shown.err
    result = json.loads(shown.out)
    assert result["samples"] == 240
    assert result["teacher_cm"] < 0.01  # the joints that were measured put the hand where the tracker saw it
    assert result["mean_cm"] < 0.5
    assert run("evaluate", tmp_path / "out.npz", "circles", "--linear-from", log, *MAPPED, "--json") == 0
    assert json.loads(capsys.readouterr().out)["linear_cm"] > 0.0
    ours = tmp_path / "ours.mcap"
    options = ("--rule", "forward-inverse", "--tick-rate", 30, "--robot", robot, "--out", ours)
    assert run("convert", log, *MAPPED, *options, "--json") == 0
    capsys.readouterr()
    assert run("evaluate", tmp_path / "out.npz", log, *MAPPED, "--linear-from", ours, "--json") == 0
    assert json.loads(capsys.readouterr().out)["linear_cm"] > 0.0


def test_where_nothing_is_aligned_its_options_are_refused(
    log: Path, trained: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    trained(log, *MAPPED)
    write_foreign(tmp_path / "ours.mcap", [])
    for options, line in (
        (("--tick-rate", "10"), "circles: expected none of --tick-rate"),
        (MAPPED, "circles: expected no --map beside it"),
        (("--deploy", *MAPPED), "--deploy: expected no --map beside it"),
        (("--deploy", "--own-time", "--frame", "/x=0,0,0,0,0,0,1"), "--deploy: expected none of --tick-rate"),
        ((*MAPPED, "--linear-from", tmp_path / "ours.mcap"), "expected a topic /tracker, found none"),
    ):
        assert run("evaluate", tmp_path / "out.npz", "circles", *options) == 2
        assert line in capsys.readouterr().err


def test_names_of_a_projects_settings_are_none_of_a_motions(
    log: Path, trained: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    trained(log, *MAPPED)
    (tmp_path / "reenact.toml").write_text(f'map = ["{MAPPED[1]}"]\n')
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(app.app, ["evaluate", "out.npz", "circles", "--json"])
    assert result.exit_code == 0, result.exception


def holed(robot: Path, path: Path) -> Path:
    """Write a recording with a second in which nothing was recorded."""
    return write_foreign(path, [r for r in recording(robot) if not 3 * 10**9 < r.log_time_ns - START < 4 * 10**9])


def test_a_golden_case_has_the_ticks(
    robot: Path, trained: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Each episode as a log of its own, which come to the digest of training."""
    log = holed(robot, tmp_path / "holed.mcap")
    result, _, _ = trained(log, *MAPPED)
    options = ("--robot", robot, "--rule", "forward-inverse", "--epochs", 1, *MAPPED, "--cases", tmp_path / "golden")
    assert run("golden", "add", log, *options, "--name", "lab", "--json") == 0
    assert json.loads(capsys.readouterr().out)["digest"] == result["digest"]
    assert {path.name for path in (tmp_path / "golden" / "lab").glob("*.mcap")} == {"holed.mcap", "holed_1.mcap"}
    assert run("golden", "check", tmp_path / "golden") == 0


def test_a_replay_presents_the_ticks(robot: Path, trained: Any, tmp_path: Path) -> None:
    """A learner that is fed them comes to the digests of training."""
    log = holed(robot, tmp_path / "holed.mcap")
    result, _, _ = trained(log, *MAPPED)
    endpoint, out = free_endpoint(), tmp_path / "fed.npz"
    arguments = ("--listen", endpoint, "--rule", "forward-inverse", "--out", out, "--json")
    with start("learn", *arguments, cwd=tmp_path) as learner:
        wait_for_line(learner, "waits for a replay")
        options = ("--rule", "forward-inverse", "--epochs", 1, "--robot", robot, *MAPPED, "--connect", endpoint)
        assert run("replay", log, *options, "--json") == 0
        fed = json.loads(learner.communicate(timeout=120)[0])
    assert {name: fed[name] for name in ("digest", "stream_digest", "ticks")} == {
        name: result[name] for name in ("digest", "stream_digest", "ticks")
    }
    assert Controller.load(out).provenance["logs"][0]["alignment"]["episodes"] == 2


def test_live_learning_aligns_as_training_does(
    robot: Path, trained: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Messages of a lab as they come, by the lab's names: the digest of `train --as-live`."""
    log = holed(robot, tmp_path / "holed.mcap")
    options = (*MAPPED, "--tick-rate", 20)
    result, _, _ = trained(log, *options, "--as-live")
    endpoint, out = free_endpoint(), tmp_path / "live.npz"
    arguments = ("--listen", endpoint, "--robot", robot, "--rule", "forward-inverse", "--out", out, "--json")
    with start("learn", "--live", *arguments, *options, cwd=tmp_path) as learner:
        wait_for_line(learner, "learns more")
        assert run("replay", log, "--play", "--await", "learner", "--connect", endpoint) == 0
        live = json.loads(learner.communicate(timeout=120)[0])
    assert {name: live[name] for name in ("digest", "ticks")} == {name: result[name] for name in ("digest", "ticks")}
    assert (live["gaps"], live["missed"], live["aligned"]) == (1, 21, result["ticks"])
    assert Controller.load(out).provenance["logs"][0]["alignment"]["period_ns"] == 50 * MS
    assert run("learn", "--map", "/a=/b", "--out", tmp_path / "x.npz") == 2
    assert "learn without --live, whose replay aligns: expected no --map beside it" in capsys.readouterr().err


def test_a_served_controller_takes_a_labs_topics(log: Path, robot: Path, trained: Any) -> None:
    """Targets by another name are answered at once, and what is learned meanwhile is aligned apart from them."""
    _, _, controller = trained(log, *MAPPED)
    renames = {"/tracker": "/hand/tip/measured", "/teleop": "/hand/tip/target"}
    config = ServeConfig(serving=ServingConfig(learn=True), alignment=AlignmentConfig(), renames=renames)
    served = ServedController(controller, config=config.serving)
    inputs = ServedInputs(controller, config, served.topics)
    assert set(inputs.topics) >= {"/teleop", "/tracker", "/joint_states"}
    recorded = recording(robot)[:300]
    targets = [r._replace(topic="/teleop", log_time_ns=r.log_time_ns + 1) for r in recorded if r.topic == "/tracker"]
    answered = 0
    for record in sorted([*recorded, *targets], key=lambda record: record.log_time_ns):
        commands = [command for taken in inputs.taken(record) if (command := served.take(taken)) is not None]
        assert len(commands) == (record.topic == "/teleop")
        answered += len(commands)
    assert answered == len(targets) > 60
    counts = served.counts()
    assert len(targets) - 2 <= counts["learned_steps"] <= len(targets)
    assert counts["refused"] == inputs.counts["unaligned"] == 0


def test_what_is_left_aside_is_reported(
    log: Path, robot: Path, trained: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The last fifth of the ticks is not learned; nor are whole logs that are named."""
    result, _, _ = trained(log, *MAPPED, "--hold-out", "0.2")
    assert (result["ticks"], result["held_out"]["samples"]) == (2 * 192, 48)
    assert 0.0 < result["held_out"]["tip_cm"] == result["held_out"]["mean_cm"] <= result["held_out"]["max_cm"]
    assert list(result["held_out"]["joints"]) == list(load_robot(robot).joints)
    assert all(0.0 <= found["mean"] <= found["max"] for found in result["held_out"]["joints"].values())
    part = write_foreign(tmp_path / "part.mcap", [r for r in recording(robot) if r.log_time_ns < START + 6 * 10**9])
    whole, _, _ = trained(part, *MAPPED, "--hold-out", log)
    without, _, _ = trained(part, *MAPPED)
    assert whole["digest"] == without["digest"] != result["digest"]
    assert whole["held_out"]["samples"] == 240
    for wrong in ("1.5", "0"):
        arguments = ("--robot", robot, "--rule", "forward-inverse", *MAPPED, "--out", tmp_path / "x.npz")
        assert run("train", log, *arguments, "--hold-out", wrong) == 2
        assert f"--hold-out: expected a share between 0 and 1, such as 0.2, or a log, found '{wrong}'" in (
            capsys.readouterr().err
        )


def still(records: list[RecordedMessage]) -> list[RecordedMessage]:
    return changed(records, "/tracker", lambda pose, stamp: PoseStamped(stamp, np.array((0.5, 0.0, 0.75))))


def no_quaternion(records: list[RecordedMessage]) -> list[RecordedMessage]:
    return changed(records, "/tracker", lambda pose, stamp: PoseStamped(stamp, pose.position, orientation=np.zeros(4)))


def an_hour_apart(records: list[RecordedMessage]) -> list[RecordedMessage]:
    return changed(records, "/tracker", lambda pose, stamp: PoseStamped(stamp + 3600 * 10**9, pose.position))


def other_joints(records: list[RecordedMessage]) -> list[RecordedMessage]:
    return changed(records, "/joint_states", lambda state, stamp: JointState(stamp, ("a", "b"), np.zeros(2)))


def unstamped(records: list[RecordedMessage]) -> list[RecordedMessage]:
    return changed(records, "/tracker", lambda pose, stamp: PoseStamped(0, pose.position))


def anew(records: list[RecordedMessage]) -> list[RecordedMessage]:
    """Return messages of whose stamps those of the second half are a day earlier."""
    half = len(records) // 2
    moved = changed(records[half:], "/tracker", lambda pose, stamp: replace(pose, stamp_ns=stamp - 86400 * 10**9))
    moved = changed(moved, "/joint_states", lambda state, stamp: replace(state, stamp_ns=stamp - 86400 * 10**9))
    return [*records[:half], *moved]


def backwards(records: list[RecordedMessage]) -> list[RecordedMessage]:
    return changed(records, "/tracker", lambda pose, stamp: replace(pose, stamp_ns=START + 5 * 10**9 - stamp % 10**9))


def changed(records: list[RecordedMessage], topic: str, change: Any) -> list[RecordedMessage]:
    """Return messages of which those of one topic are others."""
    from recorders.cdr.codec import decode

    found = []
    for record in records:
        if record.topic == topic:
            message = decode(record.type, record.data)
            record = record._replace(data=encode(change(message, message.stamp_ns)))
        found.append(record)
    return found


@pytest.mark.parametrize(
    ("change", "line"),
    [
        (still, "/tracker: expected a hand that moves as the joints do, found it at (0.5, 0, 0.75) m all the time"),
        (no_quaternion, "/tracker: expected messages that can be used, found 240 with a quaternion of zero length"),
        (an_hour_apart, "found those of /tracker 3600.005 s after"),
        (other_joints, "expected a topic of sensor_msgs/msg/JointState with the joints of the robot, turn, tip_yaw"),
        (other_joints, "found /joint_states without turn, tip_yaw, tip_shoulder, tip_elbow, with a, b"),
        (anew, "expected stamps of one clock, found a clock that began anew; take the times of recording with"),
        (
            backwards,
            "/tracker: expected stamps that rise in order of arrival, found 232 messages out of order and",
        ),
        (unstamped, "found 240 without a stamp; take the times of recording with --clock log"),
    ],
)
def test_what_cannot_be_aligned_is_one_line(
    robot: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], change: Any, line: str
) -> None:
    bad = write_foreign(tmp_path / "bad.mcap", change(recording(robot)))
    assert run("train", bad, "--robot", robot, "--rule", "forward-inverse", *MAPPED, "--out", tmp_path / "x.npz") == 2
    shown = capsys.readouterr().err
    assert line in shown
    assert shown.count("\n") == 1
    assert not (tmp_path / "x.npz").exists()


def test_a_topic_of_two_types_and_targets_that_are_not_there_are_one_line(
    log: Path, robot: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mixed = tmp_path / "mixed.mcap"
    with mixed.open("wb") as file:
        writer = Writer(file)
        writer.start()
        mixture = [(message.TYPE, encode(message)) for message in (PoseStamped(START, np.zeros(3)), String(""))]
        tracked = [RecordedMessage("/tracker", kind, data, 0, START) for kind, data in mixture]
        for record in (*tracked, *recording(robot, tracked=False)[:9]):
            schema = writer.register_schema(record.type, "ros2msg", schema_text(record.type).encode())
            channel = writer.register_channel(record.topic, "cdr", schema)
            writer.add_message(channel, record.log_time_ns, record.data, record.log_time_ns)
        writer.finish()
    arguments = ("--robot", robot, "--out", tmp_path / "x.npz")
    assert run("train", mixed, *arguments, *MAPPED, "--rule", "forward-inverse") == 2
    line = f"/tracker: expected messages of one type, found {PoseStamped.TYPE}, {String.TYPE}"
    assert line in capsys.readouterr().err
    assert run("train", log, *arguments) == 2
    line = "expected messages on /hand/tip/target, found none; rename one of /tracker with --map, or learn from hands"
    line += " as measured or from joints alone, with --rule forward-inverse"
    assert line in capsys.readouterr().err


@pytest.mark.parametrize(
    ("options", "line"),
    [
        (("--tick-rate", "0"), "--tick-rate: expected a rate from 0.001 to 1000 Hz, found '0'"),
        (("--tick-rate", "10", "--ticks-of", "/tracker"), "expected one of --tick-rate and --ticks-of, found both"),
        (("--ticks-of", "/camera"), "--ticks-of: expected a topic of joints or poses, found /camera; there are: "),
        (("--latency", "/camera=0.1"), "--latency: expected a topic /camera, found none"),
        (("--latency", "/tracker=soon"), "--latency /tracker: expected seconds within 3600 of 0, such as 0.02, found"),
        (("--frame", "/tracker=1,2,3,0,0,0"), "--frame /tracker: expected seven numbers x,y,z,qx,qy,qz,qw, found"),
        (("--frame", "/tracker=1,2,3,0,0,0,0"), "--frame /tracker: expected a quaternion with a length, found"),
        (("--clock", "sun"), "--clock: expected header or log, found 'sun'"),
        (("--tolerance", "60"), "--tolerance: expected seconds within 5 of 0, such as 0.02, found '60'"),
        (("--tick-rate", "10", "--as-recorded"), "--as-recorded: expected none of --tick-rate"),
        (("--tolerance", "0.1", "--as-recorded"), "--as-recorded: expected none of --tick-rate"),
        (("--clock", "header", "--as-recorded"), "--as-recorded: expected none of --tick-rate"),
    ],
)
def test_a_wrong_option_is_one_line(
    log: Path, robot: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], options: tuple[str, ...], line: str
) -> None:
    arguments = (log, "--robot", robot, "--rule", "forward-inverse", *MAPPED, "--out", tmp_path / "x.npz", *options)
    assert run("train", *arguments) == 2
    shown = capsys.readouterr().err
    assert line in shown
    assert shown.count("\n") == 1
