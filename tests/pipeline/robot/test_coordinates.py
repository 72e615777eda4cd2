"""Rows and inputs are each other's; kinematics, messages and motions agree on how a hand is turned, and on how far."""

from pathlib import Path

import numpy as np
import pytest
from more_hands import THREE, write_motion, write_robot
from scipy.spatial.transform import Rotation

from pipeline.arrays import Floats
from pipeline.motions.motion import load_motion
from pipeline.robot.config import RobotConfig, load_robot, parse_robot
from pipeline.robot.coordinates import centre_rows, hand_slices, positions_of, to_inputs, to_rows, turns_of
from pipeline.robot.kinematics import Kinematics
from pipeline.robot.range_check import range_check
from pipeline.samples.pairing import find_pairing
from pipeline.simulation.simulation import Simulation
from recorders.errors import MessageError, MotionError, RobotError
from recorders.messages.message_types import JointState, PoseStamped
from recorders.messages.topics import hand_measured, hand_target
from recorders.ticks.joiner import Tick

POSED = THREE[1]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_robot(tmp_path_factory.mktemp("posed") / "robot", THREE, poses=(POSED,))


@pytest.fixture(scope="module")
def robot(folder: Path) -> RobotConfig:
    return load_robot(folder)


def some_inputs(robot: RobotConfig, count: int = 50) -> Floats:
    drawn = np.random.default_rng(3).uniform(-1.0, 1.0, (count, robot.input_centre.size))
    inputs: Floats = robot.input_centre + robot.input_reach * drawn
    return inputs


def test_inputs_and_rows_are_each_others(robot: RobotConfig) -> None:
    inputs = some_inputs(robot)
    rows = to_rows(robot, inputs)
    assert (inputs.shape, rows.shape) == ((50, 12), (50, 3, 7))
    np.testing.assert_allclose(to_inputs(robot, rows), inputs, rtol=0.0, atol=1e-15)
    np.testing.assert_array_equal(positions_of(robot, inputs), rows[..., :3])
    middle = Rotation.from_quat(robot.hands[1].orientation)
    turned = Rotation.from_rotvec(turns_of(robot, inputs)[POSED]) * middle
    assert (turned * Rotation.from_quat(rows[:, 1, 3:]).inv()).magnitude().max() < 1e-15
    np.testing.assert_array_equal(rows[:, [0, 2], 3:], np.broadcast_to([0.0, 0.0, 0.0, 1.0], (50, 2, 4)))
    np.testing.assert_allclose(to_inputs(robot, centre_rows(robot)), robot.input_centre, rtol=0.0, atol=1e-16)


def test_without_a_pose_they_are_positions_in_a_row(robot: RobotConfig) -> None:
    asimo = load_robot("asimo")
    inputs = some_inputs(asimo)
    assert to_rows(asimo, inputs).tobytes() == to_inputs(asimo, inputs.reshape(-1, 2, 3)).tobytes() == inputs.tobytes()
    assert turns_of(asimo, inputs) == {}


def test_kinematics_has_inputs_and_how_they_move(robot: RobotConfig) -> None:
    kinematics, step = Kinematics(robot), 1e-6
    for q in robot.comfort + np.random.default_rng(4).uniform(-0.4, 0.4, (5, len(robot.joints))):
        inputs, jacobian = kinematics.inputs_and_jacobian(q)
        np.testing.assert_array_equal(inputs, kinematics.inputs(q))
        np.testing.assert_array_equal(positions_of(robot, inputs), kinematics.hands(q))
        moved = [(kinematics.inputs(q + d) - kinematics.inputs(q - d)) / (2.0 * step) for d in step * np.eye(len(q))]
        np.testing.assert_allclose(jacobian, np.transpose(moved), rtol=0.0, atol=1e-8)
    positions = [row for where in hand_slices(robot) for row in range(where.start, where.start + 3)]
    np.testing.assert_array_equal(jacobian[positions], kinematics.hands_and_jacobian(q)[1])


def test_hands_computed_of_joints_are_inputs_too(robot: RobotConfig) -> None:
    pairs, u, d = find_pairing("computed").pairs(robot), np.empty(12), np.empty(12 + len(robot.joints))
    for q in robot.comfort + np.random.default_rng(5).uniform(-0.4, 0.4, (5, len(robot.joints))):
        assert pairs.fill(Tick(0, (), JointState(0, robot.joints, q), ()), u, d)
        np.testing.assert_allclose(u, Kinematics(robot).inputs(q), rtol=0.0, atol=1e-14)
        assert d.tobytes() == np.concatenate([u, q]).tobytes()


def test_the_simulation_measures_the_pose(robot: RobotConfig) -> None:
    simulation = Simulation(robot)
    simulation.reset(robot.comfort + 0.1)
    found = to_inputs(robot, simulation.hands())
    np.testing.assert_allclose(found, Kinematics(robot).inputs(robot.comfort + 0.1), rtol=0.0, atol=1e-12)


def pose_turned(robot: RobotConfig, angle_rad: float) -> PoseStamped:
    """Return a pose in the middle of the box, turned about x."""
    orientation = Rotation.from_rotvec([angle_rad, 0.0, 0.0]) * Rotation.from_quat(robot.hands[1].orientation)
    return PoseStamped(0, np.array(robot.hands[1].centre), orientation=orientation.as_quat())


def test_messages_are_read_up_to_where_turns_are_regular(robot: RobotConfig) -> None:
    poses = range_check(robot).poses
    assert poses.keys() == {hand_target(POSED), hand_measured(POSED)}
    read = poses[hand_target(POSED)]
    np.testing.assert_allclose(read(pose_turned(robot, 2.59))[3:], [2.59, 0.0, 0.0], rtol=0.0, atol=1e-14)
    for angle in (2.61, np.pi, -2.61):
        with pytest.raises(MessageError, match=r"expected hand right within 149 degrees of .* middle, found 1[58]0"):
            read(pose_turned(robot, angle))


@pytest.mark.parametrize("orientation", [np.zeros(4), np.array([0.0, 0.0, 0.0, 1.5]), np.full(4, np.nan)])
def test_what_is_no_unit_quaternion_is_refused(robot: RobotConfig, orientation: Floats) -> None:
    pose = PoseStamped(0, np.zeros(3), orientation=orientation)
    with pytest.raises(MessageError, match="expected as orientation of hand right a unit quaternion, found length"):
        range_check(robot).poses[hand_measured(POSED)](pose)


def test_a_motion_has_orientations_or_those_of_the_middle(folder: Path, robot: RobotConfig, tmp_path: Path) -> None:
    turned = load_motion(write_motion(tmp_path / "turned.csv", folder), robot)
    assert turned.targets.shape == (8, 3, 7)
    assert np.abs(turns_of(robot, to_inputs(robot, turned.targets))[POSED]).max() > 0.1
    columns = [0, *range(1, 10)]
    table = np.loadtxt(tmp_path / "turned.csv", delimiter=",", skiprows=1)[:, columns]
    names = (tmp_path / "turned.csv").read_text().split("\n")[0].split(",")
    header = ",".join(names[column] for column in columns)
    np.savetxt(tmp_path / "plain.csv", table, delimiter=",", header=header, comments="")
    for motion in (load_motion(tmp_path / "plain.csv", robot), load_motion("circles", robot)):
        assert np.abs(turns_of(robot, to_inputs(robot, motion.targets))[POSED]).max() < 1e-15


def test_a_motion_of_wrong_orientations_is_refused(folder: Path, robot: RobotConfig, tmp_path: Path) -> None:
    path = write_motion(tmp_path / "motion.csv", folder)
    header, first, *others = path.read_text().split("\n")
    path.write_text("\n".join([header.replace("right_qw", "else"), first, *others]))
    with pytest.raises(MotionError, match=r"the header lacks right_qw: expected the columns t,lx,.*right_qz,right_qw"):
        load_motion(path, robot)
    path.write_text("\n".join([header, first.rpartition(",")[0] + ",9.0", *others]))
    with pytest.raises(MotionError, match=r"sample 0, right hand: expected as orientation of hand right a unit"):
        load_motion(path, robot)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "0.9950041652780258",
            "0.5",
            r"centre of hand right .* a unit quaternion x, y, z, w, found one of length 0.50",
        ),
        (", 0.2, 0.2, 0.2]", "]", r"box of hand right .* expected six numbers"),
        (
            ", 0.2, 0.2, 0.2]",
            ", 0.2, 0.0, 0.2]",
            r"box of hand right .* turns above 0, with a diagonal of at most 2 rad",
        ),
        (
            ", 0.2, 0.2, 0.2]",
            ", 1.2, 1.2, 1.2]",
            r"box of hand right .* turns above 0, with a diagonal of at most 2 rad",
        ),
    ],
)
def test_a_wrong_pose_in_a_config_is_one_line(robot: RobotConfig, old: str, new: str, message: str) -> None:
    assert old in robot.toml_text
    with pytest.raises(RobotError, match=message):
        parse_robot(robot.toml_text.replace(old, new), robot.urdf_text)
