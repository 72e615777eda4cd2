"""An exploration's log holds what the design says a tick is, and the same exploration gives the same bytes."""

import hashlib
import os
import subprocess
import sys
from collections import deque
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pipeline.exploration.episode import ExplorationConfig, GuidedRun, plan, start_posture
from pipeline.exploration.explore import ExplorationResult, explore
from pipeline.motions.motion import Motion, read_motion_csv
from pipeline.motions.patterns.circles import circles
from pipeline.motions.patterns.eight import eight
from pipeline.robot.config import load_robot, parse_robot
from pipeline.robot.kinematics import Kinematics
from pipeline.robot.resolution import UNLIMITED
from pipeline.robot.telemetry import TopicMessage
from pipeline.simulation.simulation import Simulation, SimulationConfig
from pipeline.teacher.teacher import Teacher, TeacherConfig
from recorders.cdr.codec import decode
from recorders.errors import ConfigError, LogError, MotionError
from recorders.messages import topics
from recorders.messages.message_types import Clock, JointState, PoseStamped, String, TFMessage
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import SAMPLE_JOINTS
from recorders.reading.reader import LogReader
from recorders.ticks.joiner import JointMap, Tick, join_ticks

ROBOT = load_robot("asimo")
KINEMATICS = Kinematics(ROBOT)
SAMPLES = 8
PERIOD_NS = 200_000_000


def short_motion() -> Motion:
    """A circle of the left hand and an arc of the right, eight samples at 5 Hz."""
    angle = 2 * np.pi * np.arange(SAMPLES) / SAMPLES
    circle = 0.03 * np.stack([0 * angle, np.cos(angle), np.sin(angle)], axis=1)
    left, right = ROBOT.centres[0] + circle, ROBOT.centres[1] - circle
    return Motion("short", 0.2 * np.arange(SAMPLES), np.stack([left, right], axis=1), closed=True)


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> ExplorationResult:
    return explore(ROBOT, short_motion(), seed=5, out=tmp_path_factory.mktemp("log") / "short.mcap")


@pytest.fixture(scope="module")
def unrounded(tmp_path_factory: pytest.TempPathFactory) -> ExplorationResult:
    """The same of a robot whose sensors have no resolution."""
    robot = replace(ROBOT, resolution=UNLIMITED)
    return explore(robot, short_motion(), seed=5, out=tmp_path_factory.mktemp("unrounded") / "short.mcap")


def ticks_of(path: Path) -> list[Tick]:
    return list(join_ticks(LogReader(path)))


def records_of(path: Path, topic: str) -> list[RecordedMessage]:
    return list(LogReader(path).records(topics=[topic]))


def joints_of(ticks: list[Tick]) -> np.ndarray:
    joint_map = JointMap(ROBOT.joints)
    return np.array([joint_map.positions(tick.joints) for tick in ticks])


def test_t_samples_give_t_plus_one_ticks_and_the_last_repeats_the_first(log: ExplorationResult) -> None:
    ticks = ticks_of(log.path)
    motion = short_motion()
    assert len(ticks) == log.ticks == SAMPLES + 1
    targets = np.array([tick.hands for tick in ticks])
    np.testing.assert_array_equal(targets, [*motion.targets, motion.targets[0]])
    stamps = np.array([tick.stamp_ns for tick in ticks])
    np.testing.assert_array_equal(np.diff(stamps), PERIOD_NS)
    assert stamps[0] == SAMPLES * PERIOD_NS  # the first cycle settles


def test_joints_of_a_tick_are_measured_before_its_target_is_held(unrounded: ExplorationResult) -> None:
    """q at tick k+1 belongs to u(k): the hands are near the target before, not near the new one."""
    ticks = ticks_of(unrounded.path)
    hands = KINEMATICS.hands_along(joints_of(ticks))
    targets = np.array([tick.hands for tick in ticks])
    to_held = np.linalg.norm(hands[1:] - targets[:-1], axis=2)
    to_new = np.linalg.norm(hands[1:] - targets[1:], axis=2)
    assert to_held.mean() < to_new.mean()
    assert unrounded.teacher_error_cm == pytest.approx(100 * to_held.mean(), abs=1e-9)


def test_the_recorded_cycle_closes(log: ExplorationResult) -> None:
    joints = joints_of(ticks_of(log.path))
    np.testing.assert_allclose(joints[-1], joints[0], atol=2e-3)


def test_measured_hands_are_those_of_the_joints_at_the_same_instant(unrounded: ExplorationResult) -> None:
    ticks = ticks_of(unrounded.path)
    expected = KINEMATICS.hands_along(joints_of(ticks))
    for side, topic in enumerate((topics.LEFT_MEASURED, topics.RIGHT_MEASURED)):
        measured = [decode(record.type, record.data) for record in records_of(unrounded.path, topic)]
        assert all(isinstance(message, PoseStamped) for message in measured)
        assert [message.stamp_ns for message in measured] == [tick.stamp_ns for tick in ticks]
        np.testing.assert_allclose([message.position for message in measured], expected[:, side], atol=1e-12)


def test_the_robot_speaks_at_its_own_rate(log: ExplorationResult) -> None:
    first, last = SAMPLES * PERIOD_NS, 2 * SAMPLES * PERIOD_NS
    expected = list(range(first, last, 20_000_000))
    for topic in (topics.JOINT_STATES, topics.TF, topics.CLOCK):
        assert [record.log_time_ns for record in records_of(log.path, topic)] == [*expected, last]
    assert [record.log_time_ns for record in records_of(log.path, topics.JOINT_COMMANDS)] == expected
    assert [record.sequence for record in records_of(log.path, topics.CLOCK)] == list(range(len(expected) + 1))


def test_log_time_is_simulation_time(log: ExplorationResult) -> None:
    for record in LogReader(log.path):
        message = decode(record.type, record.data)
        if isinstance(message, Clock):
            assert message.clock_ns == record.log_time_ns
        elif isinstance(message, JointState | PoseStamped):
            assert message.stamp_ns == record.log_time_ns


def test_the_robot_describes_itself_once_and_tf_names_its_links(log: ExplorationResult) -> None:
    (record,) = records_of(log.path, topics.ROBOT_DESCRIPTION)
    description = decode(record.type, record.data)
    assert isinstance(description, String)
    assert description.data == ROBOT.urdf_text
    tf = decode(topics.TOPICS[topics.TF].type, records_of(log.path, topics.TF)[0].data)
    assert isinstance(tf, TFMessage)
    children = [transform.child_frame_id for transform in tf.transforms]
    assert {"left_hand", "right_hand", "torso", "head"} <= set(children)
    assert len(children) == len(set(children)) == 18


def test_commands_lead_the_joints(log: ExplorationResult) -> None:
    commands = [decode(record.type, record.data) for record in records_of(log.path, topics.JOINT_COMMANDS)]
    states = [decode(record.type, record.data) for record in records_of(log.path, topics.JOINT_STATES)]
    commanded = np.array([message.position for message in commands])
    measured = np.array([message.position for message in states[:-1]])
    now, later = (np.abs(commanded[: len(measured) - k] - measured[k:]).mean() for k in (0, 2))
    assert later < now  # 40 ms later the joints are nearer to what was asked


def test_the_manifest_says_what_made_the_log(log: ExplorationResult) -> None:
    reader = LogReader(log.path)
    manifest = reader.manifest
    assert manifest["robot"] == "asimo"
    assert manifest["seed"] == 5
    assert manifest["motion"] == {"name": "short", "sha256": short_motion().sha256, "samples": 8, "closed": True}
    assert TeacherConfig(**manifest["teacher"]) == TeacherConfig()
    assert SimulationConfig(**manifest["simulation"]) == SimulationConfig()
    assert ExplorationConfig(**manifest["exploration"]) == ExplorationConfig()
    np.testing.assert_array_equal(manifest["start_posture"], start_posture(ROBOT, seed=5, spread=0.05))
    assert manifest["content_sha256"] == log.content_sha256
    again = parse_robot(reader.attachment("robot.toml").decode(), reader.attachment("robot.urdf").decode())
    assert again.joints == ROBOT.joints


def test_the_same_exploration_gives_the_same_bytes_in_another_process(log: ExplorationResult, tmp_path: Path) -> None:
    program = (
        "import sys; sys.path.insert(0, sys.argv[1])\n"
        "from test_exploration import ROBOT, explore, short_motion\n"
        "explore(ROBOT, short_motion(), seed=5, out=sys.argv[2])\n"
    )
    command = [sys.executable, "-c", program, str(Path(__file__).parent), str(tmp_path / "again.mcap")]
    # The machine may choose its BLAS kernel by a variable; another kernel may differ in the last bit.
    variables = {**os.environ, "PYTHONHASHSEED": "77", "PYTHONPATH": ":".join(sys.path)}
    subprocess.run(command, check=True, env=variables)
    hashes = {hashlib.sha256(path.read_bytes()).hexdigest() for path in (log.path, tmp_path / "again.mcap")}
    assert len(hashes) == 1


def test_another_seed_starts_elsewhere_and_ends_up_with_the_same_motion(log: ExplorationResult, tmp_path: Path) -> None:
    other = explore(ROBOT, short_motion(), seed=6, out=tmp_path / "other.mcap")
    assert other.content_sha256 != log.content_sha256
    start, other_start = (LogReader(path).manifest["start_posture"] for path in (log.path, other.path))
    assert np.abs(np.subtract(start, other_start)).max() > 0.01
    mine, its = joints_of(ticks_of(log.path)), joints_of(ticks_of(other.path))
    np.testing.assert_allclose(its[2:], mine[2:], atol=2e-3)


def test_a_robot_that_is_placed_is_where_one_that_was_led_all_the_way_is() -> None:
    short = short_motion()
    motion = Motion("slow", 2.0 * short.times_s, short.targets, closed=True)
    motion_plan = plan(motion, period_ns=TeacherConfig().period_ns, settle_ns=0)
    ways: dict[str, list[TopicMessage]] = {}
    for way in ("led", "placed"):
        robot = Simulation(ROBOT)
        robot.reset(ROBOT.comfort)
        episode = GuidedRun(robot, Teacher(KINEMATICS), start=ROBOT.comfort)
        if way == "led":
            deque(episode.settle(motion_plan), maxlen=0)
        else:
            episode.settle_placed(motion_plan, robot, driven_ns=ExplorationConfig().settle_ns)  # of 3.2 s
        ways[way] = [(topic, message) for topic, message in episode.cycle(motion_plan) if topic == SAMPLE_JOINTS]
    assert len(ways["led"]) == SAMPLES + 1
    for (_, expected), (_, found) in zip(ways["led"], ways["placed"], strict=True):
        assert isinstance(expected, JointState)
        assert isinstance(found, JointState)
        assert found.stamp_ns == expected.stamp_ns
        np.testing.assert_allclose(found.position, expected.position, rtol=0, atol=1e-11)


def test_start_postures_keep_within_the_limits() -> None:
    for seed in range(50):
        posture = start_posture(ROBOT, seed=seed, spread=0.5)
        assert (ROBOT.lower < posture).all()
        assert (posture < ROBOT.upper).all()


def test_an_open_motion_settles_on_its_first_target_and_ends_with_its_last(tmp_path: Path) -> None:
    rows = ["t,lx,ly,lz,rx,ry,rz"]
    rows += [f"{0.1 * k:.1f},0.32,0.2,0.76,0.32,{-0.25 + 0.01 * k:.2f},0.8" for k in range(6)]
    (tmp_path / "line.csv").write_text("\n".join(rows))
    motion = read_motion_csv(tmp_path / "line.csv", ROBOT.hand_names)
    done: list[float] = []
    result = explore(ROBOT, motion, seed=0, out=tmp_path / "line.mcap", progress=done.append)
    ticks = ticks_of(result.path)
    assert len(ticks) == result.ticks == 7
    assert [tick.stamp_ns for tick in ticks] == [2_000_000_000 + k * 100_000_000 for k in range(7)]
    np.testing.assert_array_equal([tick.hands[1] for tick in ticks], [*motion.targets[:, 1], motion.targets[:, 1][-1]])
    first = KINEMATICS.hands_along(joints_of(ticks))[0]
    np.testing.assert_allclose(first, motion.targets[0], atol=2e-3)
    assert done == sorted(done)
    assert done[-1] == 1.0


def test_the_teacher_follows_pattern_2_to_about_a_centimetre(tmp_path: Path) -> None:
    result = explore(ROBOT, eight(ROBOT), seed=0, out=tmp_path / "eight.mcap")
    assert 0.9 < result.teacher_error_cm < 1.4
    joints = joints_of(ticks_of(result.path))
    np.testing.assert_allclose(joints[-1], joints[0], atol=1e-4)  # cycles repeat


def test_a_motion_out_of_reach_leaves_no_log(tmp_path: Path) -> None:
    motion = circles(ROBOT)
    far = Motion("far", motion.times_s, np.add(motion.targets, [[2.0], [0.0]]), closed=True)
    with pytest.raises(MotionError, match="out of reach"):
        explore(ROBOT, far, seed=0, out=tmp_path / "far.mcap")
    assert list(tmp_path.iterdir()) == []


def test_a_motion_sampled_faster_than_the_teacher_works_is_refused(tmp_path: Path) -> None:
    motion = short_motion()
    fast = Motion("fast", motion.times_s / 100, motion.targets, closed=True)
    with pytest.raises(MotionError, match="samples 0 and 1 are closer than the teacher's period of 5 ms"):
        explore(ROBOT, fast, seed=0, out=tmp_path / "fast.mcap")


def test_periods_that_do_not_fit_together_leave_no_log(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="multiples of 5000000 ns, found 4000000 ns"):
        explore(ROBOT, short_motion(), seed=0, out=tmp_path / "a.mcap", teacher=TeacherConfig(period_ns=4_000_000))
    assert list(tmp_path.iterdir()) == []


def test_a_log_is_replaced_only_when_told(log: ExplorationResult) -> None:
    before = log.path.read_bytes()
    with pytest.raises(LogError, match="exists"):
        explore(ROBOT, short_motion(), seed=5, out=log.path)
    assert log.path.read_bytes() == before


@pytest.mark.parametrize("parameters", [{"state_period_ns": 0}, {"settle_ns": -1}, {"start_spread": 0.6}])
def test_parameters_out_of_range_are_refused(parameters: dict[str, float]) -> None:
    with pytest.raises(ConfigError, match="exploration"):
        ExplorationConfig(**parameters)
