"""Bags of arms as a lab records them, learned by three commands: the hand is within 0.2 cm on what was held out."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bags import as_bag
from processes import reenact
from sessions import write_foreign

from pipeline.exploration.explore import explore
from pipeline.exploration.source import source
from pipeline.robot.config import RobotConfig, load_robot
from pipeline.robot.kinematics import Kinematics
from recorders.cdr.codec import decode_as, encode
from recorders.messages.message_types import JointState, PoseStamped
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import JOINT_STATES
from recorders.reading.reader import LogReader

ARMS = {"ur5": ("ur5_joint_limited_robot.urdf", "tool0"), "so101": ("so101.urdf", "gripper_frame_link")}
EXPLORED_S = 120.0
JOINTS_NS, TRACKER_NS = 10_000_000, 33_333_333  # 100 and 30 Hz
START_NS = 1_764_000_000 * 10**9
TRACKED = ("--map", "/tracker/pose=/hand/hand/measured")
BOUND_CM = 0.2


@pytest.fixture(scope="module", params=ARMS)
def arm(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[RobotConfig, Path]:
    """The shipped robot, and a folder with its own, as `robot new` finds it, in `arm`."""
    folder = tmp_path_factory.mktemp(request.param)
    urdf, hand = ARMS[request.param]
    made = reenact(
        "robot",
        "new",
        urdf,
        "--package",
        "example-robot-data",
        "--hand",
        hand,
        "--out",
        "arm",
        cwd=folder,
        timeout_s=1800,
    )
    assert made.returncode == 0, made.stderr
    return load_robot(request.param), folder


@pytest.fixture(scope="module")
def explored(arm: tuple[RobotConfig, Path]) -> tuple[np.ndarray, np.ndarray]:
    """Times [ns], shape (n,), and joints measured at them [rad], shape (n, joints), of an exploration."""
    robot, folder = arm
    volume = source("volume", duration_s=EXPLORED_S)
    explore(
        robot,
        volume.motion(robot, seed=0),
        seed=0,
        out=folder / "volume.mcap",
        config=replace(volume.config, state_period_ns=JOINTS_NS),
        guidance=volume.guidance(robot, seed=0),
    )
    records = LogReader(folder / "volume.mcap").records(topics=[JOINT_STATES])
    states = [decode_as(JointState, record.data) for record in records]
    return np.array([state.stamp_ns for state in states]), np.array([state.position for state in states])


def lab_bag(robot: RobotConfig, explored: tuple[np.ndarray, np.ndarray], path: Path, *, noise_m: float) -> Path:
    """Write a rosbag2 folder: joints at 100 Hz, the hand by a tracker at 30 Hz, each with stamps of its own."""
    times, joints = explored
    kinematics, random = Kinematics(robot), np.random.default_rng(0)
    records = []
    for index, (time_ns, q) in enumerate(zip(times.tolist(), joints, strict=True)):
        state = JointState(START_NS + time_ns, robot.joints, q)
        records.append(_record("/joint_states", state, index, state.stamp_ns + 2_000_000))
    for index, time_ns in enumerate(range(int(times[0]) + 5_000_000, int(times[-1]), TRACKER_NS)):
        q = np.array([np.interp(time_ns, times, column) for column in joints.T])
        hand = kinematics.hands(q)[0] + random.normal(0.0, noise_m, 3)
        pose = PoseStamped(START_NS + time_ns, hand, frame_id="world")
        records.append(_record("/tracker/pose", pose, index, pose.stamp_ns + 8_000_000))
    log = write_foreign(path.with_suffix(".mcap"), sorted(records, key=lambda record: record.log_time_ns))
    return as_bag(log, path)


def _record(topic: str, message: JointState | PoseStamped, index: int, log_time_ns: int) -> RecordedMessage:
    return RecordedMessage(topic, message.TYPE, encode(message), index, log_time_ns)


def result(folder: Path, *arguments: object) -> dict[str, Any]:
    done = reenact(*arguments, "--json", cwd=folder, timeout_s=1800)
    assert done.returncode == 0, done.stderr
    return dict(json.loads(done.stdout))


@pytest.mark.campaign
@pytest.mark.extra
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("noise_m", [0.0, 0.001], ids=["exact", "tracked to a millimetre"])
@pytest.mark.parametrize("tracked", [(), TRACKED], ids=["kinematics", "tracker"])
def test_what_was_held_out_is_reached(
    arm: tuple[RobotConfig, Path], explored: Any, tracked: tuple[str, ...], noise_m: float, capsys: Any
) -> None:
    robot, folder = arm
    bag = folder / f"bag_{noise_m}"
    if not bag.exists():
        lab_bag(robot, explored, bag, noise_m=noise_m)
    learning = ("--robot", "arm", "--rule", "forward-inverse", "--out", "arm.npz", "--overwrite")
    trained = result(folder, "train", bag, *learning, "--hold-out", 0.2, *tracked)
    evaluated = result(folder, "evaluate", "arm.npz", bag, *tracked)
    held_cm = trained["held_out"]["mean_cm"]
    with capsys.disabled():
        print(
            f"\n{robot.name}, noise {noise_m * 1e3:g} mm, by {'its tracker' if tracked else 'kinematics'}: held out "
            f"{held_cm:.4f} cm, at most {trained['held_out']['max_cm']:.3f}; of all {evaluated['mean_cm']:.4f} cm"
        )
    assert held_cm <= BOUND_CM
