"""The simulated robot agrees with the kinematics, keeps exact time, and gives the same bits every time."""

import random
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest

from pipeline.robot.config import RobotConfig, load_robot, parse_robot
from pipeline.robot.kinematics import Kinematics
from pipeline.robot.resolution import UNLIMITED, on_grid
from pipeline.simulation.simulation import Simulation, SimulationConfig
from recorders.errors import ConfigError, JointError, RobotError

ASIMO = load_robot("asimo")
ROBOT = replace(ASIMO, resolution=UNLIMITED)
MS = 1_000_000


@pytest.fixture(scope="module")
def simulation() -> Simulation:
    return Simulation(ROBOT)


def shuffled(robot: RobotConfig, seed: int) -> RobotConfig:
    urdf = ElementTree.fromstring(robot.urdf_text)
    elements = list(urdf)
    random.Random(seed).shuffle(elements)
    urdf[:] = elements
    text = ElementTree.tostring(urdf, encoding="unicode")
    return replace(parse_robot(robot.toml_text, text), resolution=robot.resolution)


def wave(simulation: Simulation, start: np.ndarray) -> np.ndarray:
    """Positions and velocities while every joint is commanded about, shape (20, 2, n)."""
    simulation.reset(start)
    trace = []
    for k in range(20):
        simulation.advance(start + 0.05 * np.sin(k + np.arange(15)), 10 * MS)
        trace.append([simulation.positions, simulation.velocities])
    return np.array(trace)


def test_hands_agree_with_the_kinematics_on_ten_thousand_postures(simulation: Simulation) -> None:
    kinematics = Kinematics(ROBOT)
    postures = np.random.default_rng(0).uniform(ROBOT.lower, ROBOT.upper, (10_000, 15))
    simulated = np.empty((len(postures), 2, 3))
    for hands, q in zip(simulated, postures, strict=True):
        simulation.reset(q)
        hands[:] = simulation.hands()
    np.testing.assert_allclose(simulated, kinematics.hands_along(postures), rtol=0, atol=1e-12)


def test_positions_are_in_the_order_of_the_config(simulation: Simulation) -> None:
    simulation.reset(ROBOT.comfort)
    np.testing.assert_array_equal(simulation.positions, ROBOT.comfort)
    np.testing.assert_array_equal(simulation.velocities, 0.0)


def test_the_order_of_the_urdf_changes_no_bit(simulation: Simulation) -> None:
    expected = wave(simulation, ROBOT.comfort)
    for seed in (1, 2):
        np.testing.assert_array_equal(wave(Simulation(shuffled(ROBOT, seed)), ROBOT.comfort), expected)


def test_a_reset_forgets_everything(simulation: Simulation) -> None:
    first = wave(simulation, ROBOT.comfort)
    simulation.advance(ROBOT.comfort + 0.2, 35 * MS)
    np.testing.assert_array_equal(wave(simulation, ROBOT.comfort), first)


def test_one_long_advance_is_many_short_ones(simulation: Simulation) -> None:
    ends = []
    for parts in ([200], [5] * 40, [20, 180]):
        simulation.reset(ROBOT.comfort)
        for part in parts:
            simulation.advance(ROBOT.comfort + 0.05, part * MS)
        ends.append(simulation.positions)
    np.testing.assert_array_equal(ends[1], ends[0])
    np.testing.assert_array_equal(ends[2], ends[0])


def test_time_is_exact(simulation: Simulation) -> None:
    simulation.reset(ROBOT.comfort)
    assert simulation.time_ns == 0
    for k in range(1, 300):
        simulation.advance(ROBOT.comfort, 5 * MS)
        assert simulation.time_ns == k * 5 * MS
    updates = (
        simulation._servos._simulator.get_num_discrete_updates()
    )  # Drake's own count: not a step too few, nor too many
    assert updates == simulation.time_ns // SimulationConfig().step_ns


def test_the_robot_holds_a_posture_against_gravity(simulation: Simulation) -> None:
    start = ROBOT.comfort + 0.02
    simulation.reset(start)
    simulation.advance(start, 500 * MS)
    np.testing.assert_allclose(simulation.positions, start, atol=1e-6)


def test_the_robot_goes_where_it_is_told(simulation: Simulation) -> None:
    goal = ROBOT.comfort + 0.04
    simulation.reset(ROBOT.comfort)
    simulation.advance(goal, 1000 * MS)
    np.testing.assert_allclose(simulation.positions, goal, atol=1e-4)


def test_the_lag_is_30_ms(simulation: Simulation) -> None:
    """Behind a command that moves at constant speed, the joints stay back by speed times lag."""
    speed = 0.1
    simulation.reset(ROBOT.comfort)
    for k in range(1, 101):
        simulation.advance(ROBOT.comfort + speed * 0.005 * k, 5 * MS)
    behind = ROBOT.comfort + speed * simulation.time_ns * 1e-9 - simulation.positions
    assert np.median(behind / speed) == pytest.approx(0.03, abs=1e-3)
    np.testing.assert_allclose(behind / speed, 0.03, atol=0.01)  # light joints are pulled along by their neighbours


def test_link_poses_chain_up_to_the_hands(simulation: Simulation) -> None:
    simulation.reset(ROBOT.comfort + 0.1)
    poses = {pose.child: pose for pose in simulation.link_poses()}
    for link, expected in zip(("left_hand", "right_hand"), simulation.hands(), strict=True):
        point = np.zeros(3)
        while link != "world":
            pose = poses[link]
            x, y, z, w = pose.rotation
            turn = np.array([x, y, z])
            point = point + 2 * np.cross(turn, np.cross(turn, point) + w * point) + pose.translation
            link = pose.parent
        np.testing.assert_allclose(point, expected, atol=1e-12)


def test_drake_keeps_quiet(capfd: pytest.CaptureFixture[str]) -> None:
    Simulation(ROBOT)
    assert capfd.readouterr() == ("", "")


def test_commands_that_are_no_postures_are_refused(simulation: Simulation) -> None:
    simulation.reset(ROBOT.comfort)
    with pytest.raises(JointError, match=r"shape \(15,\), found \(3,\)"):
        simulation.advance([0.0, 0.0, 0.0], 5 * MS)
    bad = ROBOT.comfort.copy()
    bad[2] = np.nan
    with pytest.raises(JointError, match="finite position for joint hip_pitch"):
        simulation.advance(bad, 5 * MS)
    with pytest.raises(JointError, match="finite position for joint hip_pitch"):
        simulation.reset(bad)
    with pytest.raises(ConfigError, match="multiples of 5000000 ns, found 7 ns"):
        simulation.advance(ROBOT.comfort, 7)
    assert simulation.time_ns == 0
    np.testing.assert_array_equal(simulation.positions, ROBOT.comfort)


@pytest.mark.parametrize(
    "parameters",
    [{"step_ns": 0}, {"control_ns": 1_500_000}, {"lag_s": -1.0}, {"lag_s": np.nan}, {"bandwidth": 0.0}],
)
def test_parameters_out_of_range_are_refused(parameters: dict[str, float]) -> None:
    with pytest.raises(ConfigError, match="simulation"):
        SimulationConfig(**parameters)


def test_a_urdf_that_drake_cannot_build_is_refused() -> None:
    heavy = ROBOT.urdf_text.replace('<mass value="10"/>', '<mass value="1e300"/>')
    with pytest.raises(RobotError, match="does not build") as caught:
        Simulation(replace(ROBOT, urdf_text=heavy))
    assert "\n" not in str(caught.value)


def test_no_inertia_is_replaced_by_one_of_drakes_own() -> None:
    """Not even where a robot was never checked."""
    torn = replace(ROBOT, urdf_text=ROBOT.urdf_text.replace('ixx="0.264667"', 'ixx="9"'))
    with pytest.raises(RobotError, match=r"robot 'asimo': the URDF does not build: .*inertia") as caught:
        Simulation(torn)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("old", "new"),
    [("transmission_interface/SimpleTransmission", "DifferentialTransmission"), ('effort="2000"', 'effort="0"')],
)
def test_a_joint_for_which_drake_makes_no_motor_is_named(old: str, new: str) -> None:
    robot = replace(ROBOT, urdf_text=ROBOT.urdf_text.replace(old, new, 1))
    with pytest.raises(RobotError, match="Drake makes no motor for hip_height: expected a transmission"):
        Simulation(robot)


def test_an_impossible_inertia_is_one_clear_line() -> None:
    urdf = ROBOT.urdf_text
    for moment in ('izz="', 'ixx="', 'iyy="'):
        urdf = urdf.replace(moment, f"{moment}-")
    with pytest.raises(RobotError, match="link legs of the URDF: expected the inertia of a body"):
        Simulation(parse_robot(ROBOT.toml_text, urdf))


def test_sensors_and_motors_have_a_resolution_and_the_state_has_none() -> None:
    """A robot without one that is commanded on the grid moves alike, to the last bit of what is measured."""
    rounded, whole, steps = Simulation(ASIMO), Simulation(ROBOT), ASIMO.resolution
    for k in range(60):
        command = ROBOT.comfort + 0.05 * np.sin(k + np.arange(15))
        rounded.advance(command, 10 * MS)
        whole.advance(on_grid(command, steps.commands), 10 * MS)
        assert not np.array_equal(rounded.positions, whole.positions)
        for name in ("positions", "velocities"):
            expected = on_grid(getattr(whole, name), getattr(steps, name))
            assert getattr(rounded, name).tobytes() == expected.tobytes()
        assert rounded.hands().tobytes() == on_grid(whole.hands(), steps.hands).tobytes()
        for found, pose in zip(rounded.link_poses(), whole.link_poses(), strict=True):
            assert found.translation.tobytes() == on_grid(pose.translation, steps.tf).tobytes()
            assert found.rotation.tobytes() == on_grid(pose.rotation, steps.tf).tobytes()
