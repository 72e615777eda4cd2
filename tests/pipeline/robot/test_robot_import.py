"""A robot made from a model of others is that model, without what was left out; wrong names are one clear line."""

import random
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pinocchio
import pytest
from small_robot import CONFIG, IMPORT, INERTIA, JOINTS, MODEL, joint, limited, link, write_robot

from pipeline.robot.config import RobotConfig, load_robot, parse_robot
from pipeline.robot.kinematics import Kinematics
from pipeline.simulation.servos import DrakePlant
from pipeline.simulation.simulation import Simulation
from recorders.errors import RobotError

FINGERS = {"l_grip": 0.5, "r_grip": 0.5}


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> RobotConfig:
    return load_robot(write_robot(tmp_path_factory.mktemp("robots") / "small"))


def changed(folder: Path, file: str, old: str, new: str) -> Path:
    text = (write_robot(folder) / file).read_text()
    assert old in text
    (folder / file).write_text(text.replace(old, new))
    return folder


def theirs(robot: RobotConfig, q: np.ndarray) -> tuple[Any, Any]:
    """Their whole model, without the rise that is ours, at a posture of our robot; and its data."""
    model = pinocchio.buildModelFromXML(MODEL)
    whole = pinocchio.neutral(model)
    for name, value in (dict(zip(robot.joints[1:], q[1:], strict=True)) | FINGERS).items():
        whole[model.joints[model.getJointId(name)].idx_q] = value
    fan = model.joints[model.getJointId("spin")].idx_q
    whole[fan : fan + 2] = np.cos(0.7), np.sin(0.7)
    data = model.createData()
    pinocchio.framesForwardKinematics(model, data, whole)
    pinocchio.crba(model, data, whole)
    return model, data


def postures(robot: RobotConfig) -> list[np.ndarray]:
    rng = np.random.default_rng(1)
    return [rng.uniform(robot.lower, robot.upper) for _ in range(5)]


def test_the_hands_are_where_the_whole_model_has_them(robot: RobotConfig) -> None:
    turn = pinocchio.rpy.rpyToMatrix(0.0, 0.0, np.pi / 2)
    kinematics = Kinematics(robot)
    for q in postures(robot):
        model, data = theirs(robot, q)
        stand = pinocchio.SE3(turn, np.array([0.0, 0.0, 0.7 + q[0]]))
        for side, found in zip("lr", kinematics.hands(q), strict=True):
            palm = data.oMf[model.getFrameId(f"{side}_finger")].act(np.array([0.02, 0.0, -0.04]))
            np.testing.assert_allclose(found, stand.act(palm), atol=1e-11)


def test_what_is_fixed_keeps_its_mass_and_inertia(robot: RobotConfig) -> None:
    kinematics = Kinematics(robot)
    for q in postures(robot):
        model, data = theirs(robot, q)
        places = [model.joints[model.getJointId(name)].idx_v for name in robot.joints[1:]]
        expected = np.diagonal(data.M)[places]
        np.testing.assert_allclose(kinematics.inertia_diagonal(q)[1:], expected, rtol=1e-8)


def test_masses_add_up_without_what_is_dropped(robot: RobotConfig) -> None:
    urdf = ElementTree.fromstring(robot.urdf_text)
    masses = [float(mass.get("value", "")) for mass in urdf.iter("mass")]
    assert sum(masses) == pytest.approx(4.0 + 6.0 + 0.2 + 2 * (4 * 0.8 + 0.1))


def test_the_text_needs_no_file_and_comes_back_as_the_same_robot(robot: RobotConfig) -> None:
    assert "mesh" not in robot.urdf_text
    again = parse_robot(robot.toml_text, robot.urdf_text)
    assert again.joints == robot.joints == JOINTS
    np.testing.assert_array_equal(again.lower, robot.lower)


def test_every_link_but_the_frames_is_seen(robot: RobotConfig) -> None:
    urdf = ElementTree.fromstring(robot.urdf_text)
    bare = {str(element.get("name")) for element in urdf.iterfind("link") if element.find("visual") is None}
    assert bare == set()


def test_equal_input_gives_equal_text_whatever_the_models_order(robot: RobotConfig, tmp_path: Path) -> None:
    assert load_robot(write_robot(tmp_path / "same")).urdf_text == robot.urdf_text
    model = ElementTree.fromstring(MODEL)
    elements = list(model)
    random.Random(3).shuffle(elements)
    model[:] = elements
    (write_robot(tmp_path / "shuffled") / "model.urdf").write_text(ElementTree.tostring(model, encoding="unicode"))
    shuffled = Kinematics(load_robot(tmp_path / "shuffled"))
    for q in postures(robot):
        np.testing.assert_allclose(shuffled.hands(q), Kinematics(robot).hands(q), atol=1e-12)


def test_import_says_nothing_on_the_terminal(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    load_robot(write_robot(tmp_path / "small"))
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("file", "old", "new", "message"),
    [
        ("robot.toml", '"turn", weight', '"twist", weight', r"\[gaze\] joint 'turn' is not among"),
        ("robot.toml", '"l_elbow"', '"l_knee"', "joints l_knee .* not movable joints of the model, which has l_elbow"),
        ("robot.toml", '"l_elbow"', '"ankle"', "joints ankle .* not movable joints of the model, which has l_elbow"),
        ("robot.toml", '"l_elbow"', '"spin"', r"\[frozen\] joints spin are among the robot's joints"),
        ("robot.toml", 'link = "l_palm"', 'link = "l_paw"', "frames l_paw .* are not links: chest, .*l_palm"),
        (
            "import.toml",
            'drop = ["hip"]',
            'drop = ["tail"]',
            "drop: joints tail are not in the model, .* anchor, ankle",
        ),
        ("import.toml", 'drop = ["hip"]', 'drop = "hip"', "drop of the robot config: expected a list, found 'hip'"),
        ("import.toml", 'drop = ["hip"]', "dorp = []", "import.toml has unknown dorp: expected the keys base, drop"),
        (
            "import.toml",
            "l_grip = 0.5",
            "l_claw = 0.5",
            r"\[frozen\] joints l_claw .* which has l_elbow",
        ),
        ("import.toml", "l_grip = 0.5", "", r"\[frozen\] l_grip: expected between its limits 0.2 and 1, found 0"),
        ("import.toml", "l_grip = 0.5", "l_grip = nan", r"\[frozen\] l_grip .* finite number"),
        ("import.toml", 'parent = "l_finger"', 'parent = "thumb"', "frames thumb .* are not links: chest, fan"),
        ("import.toml", 'name = "l_palm"', 'name = "l_finger"', "link l_finger of the URDF is given more than once"),
        ("import.toml", 'type = "prismatic"', 'type = "slidy"', "type of rise .* expected revolute or prismatic"),
        ("import.toml", 'type = "prismatic"', "type = []", "type of rise .* expected revolute or prismatic"),
        ("import.toml", "lower = -0.1\n", "", "virtual joint rise lacks lower"),
        ("import.toml", 'name = "rise"', 'name = "turn"', "joint turn of the URDF is given more than once"),
        ("import.toml", "axis = [0.0, 0.0, 1.0]", "axis = [0.0, 1.0]", "axis of rise .* expected three numbers"),
        ("import.toml", "xyz = [0.0, 0.0, 0.7]", "xyz = 0.7", r"\[base\] xyz .* expected three numbers"),
        ("import.toml", "[base]", "[basis]", "import.toml has unknown basis"),
        ("import.toml", "[source]", "[sauce]", "import.toml lacks source"),
        ("import.toml", '"model.urdf"', '"../model.urdf"', "expected a file beside import.toml, found '../model.urdf'"),
        ("import.toml", '"model.urdf"', '"absent.urdf"', "cannot read robot file .*absent.urdf"),
        ("import.toml", "[source]", '[source]\npackage = "reenact-no-such-package"', "pip install reenact-no-such-pac"),
        ("import.toml", "[source]", '[source]\npackage = "../a b"', r"'../a b', which is not installed"),
        ("import.toml", "[source]", '[source]\npackage = "numpy"', "package 'numpy' has no file 'model.urdf'"),
        ("model.urdf", limited(-2.4, 0.1), "", "joint l_elbow of the model: expected <limit lower=.*, found none"),
        ("model.urdf", '<mass value="6.0"/>', '<mass value="much"/>', "link 'chest' .* found 'much'"),
        ("model.urdf", "</robot>", "", "not XML"),
    ],
)
def test_what_does_not_fit_is_one_clear_line(
    tmp_path: Path, file: str, old: str, new: str, message: str, capfd: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(RobotError, match=message) as caught:
        load_robot(changed(tmp_path / "small", file, old, new))
    assert "\n" not in str(caught.value)
    assert capfd.readouterr() == ("", "")


MIMIC = '<mimic joint="{}" multiplier="-2" offset="0.3"/>'


def mimicking(name: str, mimic: str) -> str:
    """The model, with a joint that is to mimic another."""
    opening = next(part for part in MODEL.split("<") if part.startswith(f'joint name="{name}"'))
    return MODEL.replace(f"<{opening}", f"<{opening}{mimic}", 1)


def folder_of(folder: Path, model: str, source: str = IMPORT, config: str = CONFIG) -> Path:
    write_robot(folder)
    for name, text in (("model.urdf", model), ("import.toml", source), ("robot.toml", config)):
        (folder / name).write_text(text)
    return folder


def test_a_frozen_joint_that_mimics_a_frozen_one_is_where_that_puts_it(tmp_path: Path) -> None:
    free = IMPORT.replace("spin = 0.7", "")
    there = IMPORT.replace("spin = 0.7", "spin = -0.7")  # -2 * 0.5 + 0.3
    mimics = load_robot(folder_of(tmp_path / "mimics", mimicking("spin", MIMIC.format("l_grip")), free))
    stands = load_robot(folder_of(tmp_path / "stands", MODEL, there))
    assert mimics.urdf_text == stands.urdf_text
    both = load_robot(folder_of(tmp_path / "both", mimicking("spin", MIMIC.format("l_grip")), there))
    assert both.urdf_text == stands.urdf_text


def test_joints_mimic_through_one_another(tmp_path: Path) -> None:
    model = mimicking("spin", MIMIC.format("r_grip")).replace(
        '<joint name="r_grip" type="revolute">', '<joint name="r_grip" type="revolute"><mimic joint="l_grip"/>'
    )
    source = IMPORT.replace("spin = 0.7", "").replace("r_grip = 0.5", "")
    there = IMPORT.replace("spin = 0.7", "spin = -0.7")
    robot = load_robot(folder_of(tmp_path / "mimics", model, source))
    assert robot.urdf_text == load_robot(folder_of(tmp_path / "stands", MODEL, there)).urdf_text


@pytest.mark.parametrize(
    ("name", "mimic", "message"),
    [
        ("spin", MIMIC.format("turn"), "joint spin of the model is to mimic turn, which is among the robot's joints"),
        ("l_elbow", MIMIC.format("turn"), "joint l_elbow of the model is to mimic 'turn': expected the robot's joints"),
        ("l_elbow", MIMIC.format("l_grip"), "joint l_elbow of the model is to mimic 'l_grip': expected the robot's"),
        ("spin", MIMIC.format("l_grip"), r"\[frozen\] spin: expected -0.7, as it is to mimic l_grip at 0.5, found 0.7"),
        ("spin", MIMIC.format("hip"), "joint spin of the model is to mimic 'hip': expected a movable joint .* dropped"),
        ("spin", MIMIC.format("none"), "joint spin of the model is to mimic 'none': expected a movable joint"),
        ("spin", MIMIC.format("anchor"), "joint spin of the model is to mimic 'anchor': expected a movable joint"),
        ("spin", MIMIC.format("spin"), "joint spin of the model is to mimic spin, which waits for another in a ring"),
        ("spin", '<mimic multiplier="2"/>', "joint spin of the model: expected <mimic joint=...>, found none"),
        ("spin", "<mimic/>", "joint spin of the model: expected <mimic joint=...>, found none"),
        ("spin", '<mimic joint="turn" multiplier="2x"/>', "joint 'spin' .* <mimic multiplier=...> .* found '2x'"),
        ("r_grip", '<mimic joint="l_grip" offset="0.6"/>', r"\[frozen\] r_grip: expected 1.1, as it is to mimic"),
    ],
)
def test_a_joint_that_mimics_what_moves_is_refused_by_name(
    tmp_path: Path, name: str, mimic: str, message: str, capfd: pytest.CaptureFixture[str]
) -> None:
    folder = folder_of(tmp_path / "small", mimicking(name, mimic))
    with pytest.raises(RobotError, match=message) as caught:
        load_robot(folder)
    assert "mimic" in str(caught.value)
    assert "\n" not in str(caught.value)
    assert capfd.readouterr() == ("", "")


def test_what_is_dropped_may_mimic_anything(tmp_path: Path) -> None:
    model = mimicking("ankle", "<mimic/>")
    assert (
        load_robot(folder_of(tmp_path / "small", model)).urdf_text == load_robot(write_robot(tmp_path / "a")).urdf_text
    )


@pytest.mark.parametrize(
    ("name", "called"),
    [
        *(("anchor", called) for called in ("pelvis", "chest", "l_finger", "world", "universe")),
        *(("spin", called) for called in ("fan", "chest", "r_finger")),
        *(("turn", called) for called in ("chest", "pelvis", "l_palm", "universe", "root_joint", "chest_parent")),
        *(("l_wrist", called) for called in ("l_wrist_link", "l_elbow_link", "world")),
    ],
)
def test_a_joint_may_be_called_as_a_link(robot: RobotConfig, tmp_path: Path, name: str, called: str) -> None:
    model = MODEL.replace(f'joint name="{name}"', f'joint name="{called}"')
    source = IMPORT.replace(f"{name} =", f"{called} =")
    config = CONFIG.replace(f'name = "{name}"', f'name = "{called}"').replace(
        f'joint = "{name}"', f'joint = "{called}"'
    )
    renamed = load_robot(folder_of(tmp_path / "small", model, source, config))
    for q in postures(robot):
        np.testing.assert_array_equal(Kinematics(renamed).hands(q), Kinematics(robot).hands(q))
    simulations = Simulation(renamed), Simulation(robot)
    for simulation in simulations:
        simulation.advance(robot.comfort + 0.01, 50_000_000)
    np.testing.assert_allclose(simulations[0].positions, simulations[1].positions, atol=1e-12)


def test_links_may_be_called_as_libraries_call_theirs(robot: RobotConfig, tmp_path: Path) -> None:
    for called in ("universe", "WorldModelInstance", "turn_parent", "a::b", "a b"):
        model, config = (text.replace('"chest"', f'"{called}"') for text in (MODEL, CONFIG))
        renamed = load_robot(folder_of(tmp_path / called.strip(":"), model, config=config))
        np.testing.assert_array_equal(Simulation(renamed).hands(), Simulation(robot).hands())


@pytest.mark.parametrize("name", ["pelvis", "chest", "fan", "l_finger", "r_wrist_link"])
def test_an_inertia_that_no_body_has_is_refused_by_its_link(tmp_path: Path, name: str) -> None:
    start = MODEL.index(f'<link name="{name}">')
    model = MODEL[:start] + MODEL[start:].replace('ixx="0.002"', 'ixx="0.02"', 1)
    with pytest.raises(RobotError, match=f"link {name} of the URDF: expected the inertia of a body"):
        load_robot(folder_of(tmp_path / "small", model))


def test_links_that_are_dropped_may_have_any_inertia(robot: RobotConfig, tmp_path: Path) -> None:
    start = MODEL.index('<link name="foot">')
    model = MODEL[:start] + MODEL[start:].replace('ixx="0.002"', 'ixx="0.02"', 1)
    assert load_robot(folder_of(tmp_path / "small", model)).urdf_text == robot.urdf_text


@pytest.mark.parametrize(
    "inertia",
    [
        '<inertia ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"/>',
        '<inertia ixx="0.001" ixy="0" ixz="0" iyy="0.002" iyz="0" izz="0.003"/>',
        '<inertia ixx="0.002" ixy="0" ixz="0.0001" iyy="0.003" iyz="0" izz="0.001"/>',
        '<inertia ixx="0.0333" ixy="0" ixz="0" iyy="0.0333" iyz="0" izz="0"/>',
    ],
    ids=["points", "flat", "flat and turned", "rods"],
)
def test_flat_bodies_have_in_drake_what_they_have_in_the_model(tmp_path: Path, inertia: str) -> None:
    robot = load_robot(folder_of(tmp_path / "small", MODEL.replace(INERTIA, inertia)))
    joints = DrakePlant(robot, step_ns=1_000_000)
    joints.finalize()
    context = joints.plant.CreateDefaultContext()
    joints.set_state(context, robot.comfort, np.zeros(len(robot.joints)))
    found = np.diagonal(joints.plant.CalcMassMatrix(context))[joints.v]
    np.testing.assert_allclose(found, Kinematics(robot).inertia_diagonal(robot.comfort), rtol=1e-9)


def test_a_free_joint_is_frozen_at_zero_only(tmp_path: Path) -> None:
    ball = link("ball", mass=0.1, centre="0 0 0") + joint("float", "chest", "ball", xyz="0 0 1", kind="floating")
    folder = changed(tmp_path / "small", "model.urdf", "</robot>", f"{ball}</robot>")
    assert "float" not in load_robot(folder).urdf_text
    (folder / "import.toml").write_text(IMPORT.replace("spin = 0.7", "float = 0.7"))
    with pytest.raises(RobotError, match=r"\[frozen\] float: expected 0 for a joint of 6 degrees of freedom"):
        load_robot(folder)


def test_hostile_import_is_one_clear_line(tmp_path: Path) -> None:
    folder = write_robot(tmp_path / "small")
    for text in ("a = " + "[" * 20_000, "frozen." + ".".join("a" * 4_000) + " = 1", "# " + "a" * 2**16):
        (folder / "import.toml").write_text(text)
        with pytest.raises(RobotError) as caught:
            load_robot(folder)
        assert "\n" not in str(caught.value)
        assert len(str(caught.value)) < 1500


def test_a_model_of_endless_joints_is_refused_at_once(tmp_path: Path) -> None:
    hairs = "".join(
        f'<link name="hair{i}"/>' + joint(f"root{i}", "chest", f"hair{i}", xyz="0 0 1", kind="fixed")
        for i in range(1_000)
    )
    with pytest.raises(RobotError, match="expected at most 1000 joints, found 1015"):
        load_robot(changed(tmp_path / "small", "model.urdf", "</robot>", f"{hairs}</robot>"))


def test_a_config_alone_is_refused(tmp_path: Path) -> None:
    (tmp_path / "robot.toml").write_text(CONFIG)
    with pytest.raises(RobotError, match=r"cannot read robot file .*robot\.urdf"):
        load_robot(tmp_path)


def test_a_link_without_mass_may_hang_on_a_joint_that_is_frozen(tmp_path: Path) -> None:
    weightless = '<mass value="0"/><inertia ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"/>'
    model = MODEL.replace(f'<mass value="0.2"/>{INERTIA}', weightless)
    assert model != MODEL
    urdf = ElementTree.fromstring(load_robot(folder_of(tmp_path / "small", model)).urdf_text)
    assert sum(float(mass.get("value", "")) for mass in urdf.iter("mass")) == pytest.approx(4.0 + 6.0 + 2 * 3.3)
