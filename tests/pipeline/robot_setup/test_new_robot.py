"""`robot new`: a folder from a URDF, whose posture, centres and boxes are where the hands move freely."""

import json
from itertools import product
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from small_robot import INERTIA, MODEL

from pipeline.cli import app as cli
from pipeline.robot.config import RobotConfig, load_robot
from pipeline.robot.hand_kinematics import HandKinematics
from pipeline.robot.kinematics import Kinematics
from pipeline.robot_setup.findings import findings
from pipeline.robot_setup.model_joints import rigid_positions
from pipeline.robot_setup.new_robot import NewRobot, RobotRequest, make_robot
from pipeline.robot_setup.reach import evenness_of, manipulability_of, sample_reach
from pipeline.robot_setup.request_texts import parse_hands, parse_limits, parse_rigid
from pipeline.urdf.description import parse_urdf
from recorders.errors import RobotError

HANDS = {"left": "l_finger", "right": "r_finger"}


@pytest.fixture(scope="module")
def urdf(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("model") / "small.urdf"
    path.write_text(MODEL)
    return path


@pytest.fixture(scope="module")
def made(urdf: Path) -> NewRobot:
    return make_robot(request(urdf))


def request(urdf: Path, **more) -> RobotRequest:
    settings = {"hands": HANDS, "rigid": {"l_grip": 0.5, "r_grip": 0.5}, "height_m": 0.7} | more
    return RobotRequest(urdf=str(urdf), name="small", **settings)


def reenact(*words: object) -> int:
    with pytest.raises(SystemExit) as end:
        cli.main([str(word) for word in words])
    assert isinstance(end.value.code, int)
    return end.value.code


def test_its_joints_are_those_that_move_the_hands_from_the_ground_outwards(made: NewRobot) -> None:
    arm = ("shoulder", "swing", "elbow", "wrist")
    assert made.config.joints == ("turn", *(f"{side}_{name}" for side in "lr" for name in arm))
    assert [joint.hands for joint in made.joints[:2]] == [("left", "right"), ("left",)]
    assert made.config.weights[0] < made.config.weights[1] == 1.0
    assert dict(made.source.frozen) == {"l_grip": 0.5, "r_grip": 0.5}


def test_a_rigid_joint_that_cannot_be_at_zero_is_in_the_middle_of_its_range() -> None:
    urdf, joints = parse_urdf(MODEL), ["l_shoulder", "l_elbow"]
    assert rigid_positions(urdf, joints, {"turn": 0.1}) == {"turn": 0.1, "l_grip": 0.6, "r_grip": 0.6}
    assert rigid_positions(urdf, joints, {}, ["r_grip"]) == {"l_grip": 0.6}


def test_the_comfort_posture_is_freer_than_nearly_all_others_and_far_from_limits(made: NewRobot) -> None:
    robot, kinematics = made.config, Kinematics(made.config)
    _, jacobian = kinematics.hands_and_jacobian(robot.comfort)
    at_rest = manipulability_of(jacobian)
    for hand in range(2):
        assert (made.reach.manipulability[:, hand] > at_rest[hand]).mean() < 0.3
    margins = np.minimum(robot.comfort - robot.lower, robot.upper - robot.comfort) / (robot.upper - robot.lower)
    assert margins.min() >= 0.1 - 0.01
    np.testing.assert_allclose(robot.centres, kinematics.hands(robot.comfort), atol=0.0051)
    assert robot.centres[:, 2].min() > 0.0


def reached(kinematics: Kinematics, targets: np.ndarray) -> float:
    """How near the hands come to targets [m], by another solver than the program's."""
    robot = kinematics.robot
    found = least_squares(
        lambda q: (kinematics.hands(q) - targets).ravel(), robot.comfort, bounds=(robot.lower, robot.upper), xtol=1e-10
    )
    return float(np.abs(found.fun).max())


def test_every_corner_of_the_boxes_is_within_reach_and_wider_ones_are_not(made: NewRobot) -> None:
    robot, kinematics = made.config, Kinematics(made.config)
    signs = np.array(list(product((-1.0, 1.0), repeat=3)))
    for left, right in zip(signs, signs[::-1], strict=True):
        assert reached(kinematics, robot.centres + np.stack([left, right]) * robot.boxes) < 0.002
    assert (robot.boxes >= 0.02).all()
    assert robot.boxes.max() <= 0.2 * made.reach.radii.min()


def test_another_seed_samples_other_postures(made: NewRobot) -> None:
    kinematics = Kinematics(made.config)
    other, same = (sample_reach(kinematics, seed=seed).postures for seed in (1, 0))
    np.testing.assert_array_equal(same, made.reach.postures)
    assert not (other == same).any()


def test_the_folder_is_the_robot(made: NewRobot, tmp_path: Path) -> None:
    written = made.write(tmp_path / "new")
    assert sorted(path.name for path in (tmp_path / "new").iterdir()) == ["import.toml", "model.urdf", "robot.toml"]
    assert (written.joints, written.urdf_text) == (made.config.joints, made.config.urdf_text)
    np.testing.assert_array_equal(written.centres, made.config.centres)
    with pytest.raises(RobotError, match="there is a robot in this folder already; --overwrite replaces"):
        made.write(tmp_path / "new")
    made.write(tmp_path / "new", overwrite=True)


def endless(tmp_path: Path, *joints: str) -> Path:
    """The model with joints that turn without end."""
    root = ElementTree.fromstring(MODEL)
    for joint in root.iterfind("joint"):
        if joint.get("name") in joints:
            joint.set("type", "continuous")
            for limit in joint.findall("limit"):
                joint.remove(limit)
    path = tmp_path / "endless.urdf"
    path.write_text(ElementTree.tostring(root, encoding="unicode"))
    return path


def test_joints_without_limits_are_asked_for_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(
        RobotError, match=r"joints without limits: turn, l_wrist: .* \[rad\] .* --limit turn=-3.14,3.14"
    ):
        make_robot(request(endless(tmp_path, "turn", "l_wrist", "spin")))


def test_limits_that_are_given_count_and_what_nobody_states_is_assumed_and_noted(tmp_path: Path) -> None:
    path = endless(tmp_path, "turn", "l_wrist")
    limits = parse_limits(["*_wrist=-0.5,0.5", "turn=-2,2,1.5,80"])
    made = make_robot(request(path, limits=limits, hands={"left": "l_finger"}))
    by_name = {joint.name: joint for joint in made.joints}
    robot = made.write(tmp_path / "new")
    for name, lower, upper in (("turn", -2.0, 2.0), ("l_wrist", -0.5, 0.5), ("l_elbow", -2.4, 0.1)):
        place = robot.joints.index(name)
        assert (robot.lower[place], robot.upper[place]) == (lower, upper)
    assert by_name["l_wrist"].assumed == ("effort", "velocity")
    assert by_name["turn"].assumed == by_name["l_elbow"].assumed == ()
    assert robot.speed_limits[robot.joints.index("turn")] == 1.5
    assert robot.speed_limits[robot.joints.index("l_elbow")] == 5.0  # the model's
    assert "effort, velocity assumed" in (tmp_path / "new" / "import.toml").read_text()


@pytest.mark.parametrize(
    ("turned_rad", "lateral"), [(-np.pi / 2.0, (1.0, 0.0, 0.0)), (3.0, (0.0, -1.0, 0.0))], ids=["-y", "-x"]
)
def test_an_arm_that_looks_elsewhere_than_along_x_draws_across_the_way_it_looks(
    turned_rad: float, lateral: tuple[float, ...], made: NewRobot, tmp_path: Path
) -> None:
    straight = '"anchor" type="fixed"><origin xyz="0 0 0" rpy="0 0 0"/>'
    assert straight in MODEL
    path = tmp_path / "turned.urdf"
    path.write_text(MODEL.replace(straight, straight.replace('rpy="0 0 0"', f'rpy="0 0 {turned_rad}"')))
    turned = make_robot(request(path, hands={"left": "l_finger"})).config
    np.testing.assert_array_equal(turned.lateral, lateral)
    ahead = turned.centres[0] @ np.cross(turned.lateral, turned.up)
    assert ahead > abs(turned.centres[0] @ turned.lateral)
    np.testing.assert_array_equal(made.config.lateral, (0.0, 1.0, 0.0))
    assert "[pattern]" not in made.config.toml_text


def test_links_that_are_no_bodies_are_all_named_with_what_leaves_them_out(tmp_path: Path) -> None:
    path = tmp_path / "bad.urdf"
    inertial = f'<inertial><mass value="0.1"/>{INERTIA.replace("0.001", "-0.001")}</inertial>'
    antennas = "".join(
        f'<link name="antenna_{side}">{inertial}</link>'
        f'<joint name="mount_{side}" type="fixed"><parent link="chest"/><child link="antenna_{side}"/></joint>'
        for side in "lr"
    )
    path.write_text(MODEL.replace("</robot>", f"{antennas}</robot>"))
    with pytest.raises(RobotError) as error:
        make_robot(request(path))
    line = str(error.value)
    assert line.startswith("link antenna_l of the URDF: expected the inertia of a body, ")
    assert "; other links that are no bodies: antenna_r; mend a copy of the model, or leave out" in line
    assert line.endswith(": --drop mount_l --drop mount_r (drop in import.toml)")
    made = make_robot(request(path, drop=("mount_l", "mount_r"), hands={"left": "l_finger"}))
    assert made.config.hand_names == ("left",)


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"hands": {"left": "nowhere"}}, "--hand: expected links of the URDF, found nowhere; it has "),
        ({"hands": {"left": "pelvis"}}, "hand left: expected at least 3 joints that move link pelvis, found none"),
        ({"limits": parse_limits(["elbow=0,1"])}, "limits of 'elbow': expected one of the joints turn, l_shoulder"),
        ({"limits": parse_limits(["turn=1,-1"])}, "limits of turn: expected a lower one below an upper one"),
        ({"rigid": {"knee": 0.0}}, "joints knee of the robot config are not movable joints of the model"),
        ({"hands": {"only": "chest"}}, "hand only: expected at least 3 joints that move link chest, found turn"),
        ({"height_m": float("nan")}, "height of the model's root: expected a finite number"),
    ],
)
def test_what_cannot_be_a_robot_is_one_line(change: dict, expected: str, urdf: Path) -> None:
    with pytest.raises(RobotError) as error:
        make_robot(request(urdf, **change))
    assert expected in str(error.value)
    assert "\n" not in str(error.value)


def test_a_urdf_that_is_none_is_named(tmp_path: Path) -> None:
    (tmp_path / "empty.urdf").touch()
    with pytest.raises(RobotError, match=r"empty\.urdf: robot description: expected the text of a URDF, found none"):
        make_robot(request(tmp_path / "empty.urdf"))


def test_a_hand_that_is_called_hand_is_not_called_so_twice(urdf: Path) -> None:
    with pytest.raises(RobotError, match=r"^hand: expected at least 3 joints that move link pelvis"):
        make_robot(request(urdf, hands={"hand": "pelvis"}))


@pytest.mark.parametrize(
    ("parse", "texts", "expected"),
    [
        (parse_hands, [], "--hand: expected the link of at least one hand"),
        (parse_hands, ["A=x"], "with a name of small letters, found 'A=x'"),
        (parse_hands, ["left_a", "left_b"], "two hands are called left, left_a and left_b"),
        (parse_limits, ["a=1"], "--limit: expected JOINT=LOWER,UPPER"),
        (parse_limits, ["a=1,nan"], "--limit: expected JOINT=LOWER,UPPER"),
        (parse_limits, ["1,2"], "--limit: expected JOINT=LOWER,UPPER"),
        (parse_rigid, ["a=x"], "--fix: expected JOINT or JOINT=POSITION"),
    ],
)
def test_an_option_that_cannot_be_read_is_one_line(parse, texts: list[str], expected: str) -> None:
    with pytest.raises(RobotError) as error:
        parse(texts)
    assert expected in str(error.value)


def test_manipulability_and_evenness_are_those_of_the_singular_values() -> None:
    jacobian = np.random.default_rng(0).normal(size=(6, 7))
    singular = np.array([np.linalg.svd(rows, compute_uv=False) for rows in (jacobian[:3], jacobian[3:])])
    np.testing.assert_allclose(manipulability_of(jacobian), singular.prod(axis=1))
    squares = singular**2
    np.testing.assert_allclose(evenness_of(jacobian), np.cbrt(squares.prod(axis=1)) / squares.mean(axis=1))
    np.testing.assert_array_equal(evenness_of(np.zeros((3, 2))), [0.0])


@pytest.fixture(scope="module")
def written(urdf: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict]:
    """A folder by the command, and what the command printed."""
    folder = tmp_path_factory.mktemp("verb") / "mine"
    with pytest.MonkeyPatch.context() as patch:
        lines: list[str] = []
        patch.setattr("pipeline.terminal.console.block", lines.append)
        options = ["--fix", "r_grip=0.5", "--fix", "turn", "--height", "0.7", "--json"]
        assert reenact("robot", "new", urdf, "--hand", "l_wrist_link", "--out", folder, *options) == 0
    return folder, json.loads(lines[0])


def test_the_command_shows_what_it_found(written: tuple[Path, dict], capsys: pytest.CaptureFixture[str]) -> None:
    folder, shown = written
    robot = load_robot(folder)
    assert robot.name == shown["robot"] == "mine"
    assert [row["comfort"] for row in shown["joints"]] == robot.comfort.tolist()
    assert shown["hands"][0] | {"reach": 0, "freedom": 0} == {
        "hand": "hand",
        "link": "l_wrist_link",
        "controls": "position",
        "centre": robot.centres[0].tolist(),
        "box": robot.boxes[0].tolist(),
        "reach": 0,
        "freedom": 0,
    }
    assert shown["rigid"] == {"r_grip": "rigid at 0.5", "turn": "rigid at 0", "l_grip": "rigid at 0.6"}
    assert shown["findings"] == []
    assert reenact("robot", "check", folder) == 0
    checked = capsys.readouterr()
    assert checked.out == f"{folder}: nothing wrong found\n"
    assert checked.err.startswith("l_wrist: moves no hand, as its axis goes through it; ")  # the hand is its own link
    assert {row["joint"]: row["hands"] for row in shown["joints"]} == {
        "l_shoulder": ["hand"],
        "l_swing": ["hand"],
        "l_elbow": ["hand"],
        "l_wrist": [],
    }


def test_made_again_it_is_the_same_and_the_table_fits_80_columns(
    written: tuple[Path, dict], urdf: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, shown = written
    again = ("robot", "new", urdf, "--hand", "l_wrist_link", "--out", folder, "--fix", "r_grip=0.5", "--fix", "turn")
    assert reenact(*again) == 2
    assert "--overwrite replaces its files" in capsys.readouterr().err
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    assert reenact(*again, "--height", 0.7, "--overwrite") == 0
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before
    lines = capsys.readouterr().out.splitlines()
    assert max(len(line) for line in lines if str(folder) not in line) <= 80
    assert all(any(row["joint"] in line for line in lines) for row in shown["joints"])


@pytest.mark.parametrize(
    ("text", "wrong", "expected"),
    [
        ("robot.toml", ("comfort = ", "comfort = 9.0 },  # "), "expected between its limits"),
        ("robot.toml", ("centre = [", "centre = [1.5, 0.0, 0.7]  # ["), "expected its centre within reach, found it"),
        (
            "robot.toml",
            ("box = [", "box = [0.9, 0.9, 0.9]  # ["),
            "expected every corner within reach, found that hand stays",
        ),
        ("import.toml", ("urdf = ", "file = "), "[source] lacks urdf"),
        ("model.urdf", ('effort="60"', 'effort="0.01"'), "expected a motor that holds the comfort posture"),
    ],
)
def test_check_names_what_is_wrong_in_one_line(
    text: str,
    wrong: tuple[str, str],
    expected: str,
    written: tuple[Path, dict],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    for name in ("robot.toml", "import.toml", "model.urdf"):
        (tmp_path / name).write_text((written[0] / name).read_text())
    whole = (tmp_path / text).read_text()
    (tmp_path / text).write_text(whole.replace(*wrong))
    assert reenact("robot", "check", tmp_path) == 1
    found = capsys.readouterr()
    assert expected in found.out.splitlines()[0]
    assert all(line.startswith("l_wrist: moves no hand") for line in found.err.splitlines())


def test_check_of_no_robot_is_bad_input(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert reenact("robot", "check", tmp_path) == 2
    assert "expected a robot's folder, with robot.toml in it" in capsys.readouterr().err


def test_options_of_the_simulation_before_new_or_check_are_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert reenact("robot", "--rate", 3, "check", "asimo") == 2
    assert "--rate: expected no option before check" in capsys.readouterr().err


def test_the_picture_is_of_this_robot(made: NewRobot, written: tuple[Path, dict], tmp_path: Path) -> None:
    from pipeline.views.reach import draw_reach

    draw_reach(made.config, made.reach, tmp_path / "one.png")
    draw_reach(made.config, made.reach, tmp_path / "two.png")
    pictures = [path.read_bytes() for path in (tmp_path / "one.png", tmp_path / "two.png", written[0] / "reach.png")]
    assert pictures[0] == pictures[1] != pictures[2]


@pytest.mark.campaign
def test_of_a_hand_the_pose_may_be_controlled(tmp_path: Path) -> None:
    path, links, _ = ARMS["ur5"]
    made = make_robot(RobotRequest(path, parse_hands(links), "ur5", package="example-robot-data", pose=True))
    robot = made.write(tmp_path / "posed")
    (hand,) = robot.hands
    assert (hand.controls, hand.turn) == ("pose", (0.3, 0.3, 0.3))
    _, rotations = HandKinematics(robot).poses(robot.comfort)
    np.testing.assert_allclose(Rotation.from_quat(hand.orientation).as_matrix(), rotations[0], atol=2e-6)
    assert list(findings(robot)) == []


def test_a_pose_takes_six_joints(urdf: Path) -> None:
    with pytest.raises(RobotError, match="hand left: expected at least 6 joints that move link l_wrist_link, found"):
        make_robot(request(urdf, hands={"left": "l_wrist_link"}, pose=True))


ARMS = {
    "panda": ("panda_description/urdf/panda.urdf", ["panda_hand_tcp"], 0.0),
    "ur5": ("ur5_joint_limited_robot.urdf", ["tool0"], 0.0),
    "so101": ("so101.urdf", ["gripper_frame_link"], 0.0),
    "baxter": ("baxter.urdf", ["left_gripper", "right_gripper"], 0.93),
}


def arm(name: str) -> RobotConfig:
    path, links, height_m = ARMS[name]
    wanted = RobotRequest(path, parse_hands(links), name, package="example-robot-data", height_m=height_m)
    return make_robot(wanted).config


@pytest.mark.campaign
@pytest.mark.parametrize("name", ARMS)
def test_the_arms_that_come_with_the_program_are_what_the_command_makes(name: str) -> None:
    made, packaged = arm(name), load_robot(name)
    assert (made.joints, made.hand_names, made.urdf_text) == (packaged.joints, packaged.hand_names, packaged.urdf_text)
    for found, stated in ((made.comfort, packaged.comfort), (made.centres, packaged.centres)):
        np.testing.assert_allclose(found, stated, atol=0.0101)  # another machine may round to the next digit
    np.testing.assert_allclose(made.boxes, packaged.boxes, atol=0.005)
