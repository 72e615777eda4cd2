"""A URDF is read the same whatever its order; what libraries would drop or complain about is refused in one line."""

import random
from xml.etree import ElementTree

import numpy as np
import pytest

from pipeline.robot.config import load_robot, parse_robot
from pipeline.robot.kinematics import Kinematics
from pipeline.simulation.servos import DrakePlant
from pipeline.simulation.simulation import Simulation
from pipeline.urdf.description import canonical_urdf, joint_links, parse_urdf
from recorders.errors import RobotError
from recorders.rerun_scene.robot import RobotModel

ASIMO = load_robot("asimo")


def changed(old: str, new: str) -> str:
    assert old in ASIMO.urdf_text
    return ASIMO.urdf_text.replace(old, new, 1)


def test_canonical_urdf_does_not_depend_on_the_order_in_the_file() -> None:
    urdf = ElementTree.fromstring(ASIMO.urdf_text)
    elements = list(urdf)
    for seed in range(5):
        random.Random(seed).shuffle(elements)
        urdf[:] = elements
        shuffled = ElementTree.tostring(urdf, encoding="unicode")
        assert "".join(canonical_urdf(shuffled).split()) == "".join(canonical_urdf(ASIMO.urdf_text).split())


def test_links_are_told_with_their_parents() -> None:
    links = joint_links(ASIMO.urdf_text)
    assert links["left_elbow"] == ("left_upper_arm", "left_forearm")
    assert links["world_to_legs"] == ("world", "legs")
    assert len(links) == 18
    assert list(links) == sorted(links)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            'xyz="0 0 0.28"',
            'xyz="0 zero 0.28"',
            "link 'legs' .* <origin xyz=...> to hold 3 finite numbers, found '0 zero",
        ),
        ('xyz="0 0 0.28"', 'xyz="0 0.28"', "3 finite numbers, found '0 0.28'"),
        ('xyz="0 0 0.28"', 'xyz="0 0 nan"', "3 finite numbers, found '0 0 nan'"),
        ('xyz="0 0 0.28"', 'xyz="0 0 1e400"', "3 finite numbers, found '0 0 1e400'"),
        ('xyz="0 0 0.28"', 'xyz="0 0 1_0"', "3 finite numbers, found '0 0 1_0'"),
        ('xyz="0 0 0.28"', 'xyz="0&#10;0 1"', r"3 finite numbers, found '0\\n0 1'"),
        ('rpy="1.5708 0 0"', 'rpy="right 0 0"', "link 'pelvis' .* <origin rpy=...>"),
        ('<mass value="10"/>', '<mass value="ten"/>', "<mass value=...> to hold 1 finite number, found 'ten'"),
        ('<mass value="10"/>', '<mass value="10 "/>', "<mass value=...> to hold 1 finite number, found '10 '"),
        ('<mass value="10"/>', "<mass/>", "expected <mass value=...>, found none"),
        ('<mass value="10"/>', '<mass value="-10"/>', "link legs of the URDF: expected a mass above 0, found -10"),
        (
            '<mass value="3"/>',
            '<mass value="0.0"/>',
            "link pelvis .* expected a mass above 0, as a joint moves it, found 0",
        ),
        ('ixx="0.264667"', 'ixx="-"', "<inertia ixx=...>"),
        ('ixx="0.264667"', "", "expected <inertia ixx=...>, found none"),
        ('<cylinder radius="0.05"', '<cylinder radius="."', "<cylinder radius=...>"),
        ('length="0.2"', 'length="0x2"', "<cylinder length=...>"),
        ('<sphere radius="0.056"', '<sphere radius="big"', "<sphere radius=...>"),
        ('<box size="0.22 0.105 0.05"/>', '<box size="0.22 0.105"/>', "<box size=...> to hold 3"),
        ('rgba="0.93 0.94 0.95 1"', 'rgba="red"', "material 'asimo_white' .* <color rgba=...> to hold 4"),
        ('<axis xyz="0 0 1"/>', '<axis xyz="up"/>', "joint 'hip_height' .* <axis xyz=...>"),
        ('lower="-0.08"', 'lower="inf"', "joint 'hip_height' .* <limit lower=...>"),
        ('upper="0.05"', 'upper=""', "joint 'hip_height' .* <limit upper=...>"),
        ('effort="2000"', 'effort="much"', "joint 'hip_height' .* <limit effort=...>"),
        ('type="prismatic"', 'type="slidy"', "hip_height .* expected a type of revolute, .* found 'slidy'"),
        ('<link name="pelvis">', '<link name="pelvis"/><link name="pelvis">', "link pelvis .* more than once"),
        ('<link name="pelvis">', "<link>", "name of a link of the URDF: expected a name, found nothing"),
        (
            '<child link="pelvis"/>',
            '<child link="hat"/>',
            "hip_height .* expected the child to be a link .* found 'hat'",
        ),
        ('<child link="pelvis"/>', '<child link="head"/>', "link head .* child of one joint, found 2"),
        ('<parent link="legs"/>', '<parent link="pelvis"/>', "links head, .*, waist_yaw of the URDF hang .* in a ring"),
        ("</robot>", '<link name="hat"/></robot>', "expected one link that is no child, found hat, world"),
        ('<robot name="asimo">', "<robot>", "name of the URDF"),
    ],
)
def test_what_is_malformed_is_refused_before_any_library_writes_to_the_terminal(
    old: str, new: str, message: str, capfd: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(RobotError, match=message) as caught:
        Kinematics(parse_robot(ASIMO.toml_text, changed(old, new)))
    assert "\n" not in str(caught.value)
    assert capfd.readouterr() == ("", "")


INERTIA = 'ixx="0.264667" ixy="0" ixz="0" iyy="0.229667" iyz="0" izz="0.0776667"'


def inertia(ixx: float, iyy: float, izz: float, *, ixy: float = 0.0, ixz: float = 0.0, iyz: float = 0.0) -> str:
    return f'ixx="{ixx}" ixy="{ixy}" ixz="{ixz}" iyy="{iyy}" iyz="{iyz}" izz="{izz}"'


@pytest.mark.parametrize(
    "moments",
    [
        inertia(1.0, 0.001, 0.001),
        inertia(0.001, 0.001, 0.0020001),
        inertia(0.001, 0.001, 0.0020000000001),
        inertia(-0.1, 0.2, 0.2),
        inertia(0.2, 0.2, 0.2, ixy=0.21),
        inertia(0.2, 0.2, 0.2, ixz=-0.15),
        inertia(0.001, 0.001, 0.001, ixy=0.001, ixz=0.001, iyz=0.001),
        inertia(0.0, 0.0, 0.0, iyz=1e-6),
        inertia(1e-9, 0.0, 0.0),
        inertia(0.0, 0.0, 1e8),
        inertia(1e300, 1e300, 1e300),
    ],
)
def test_an_inertia_that_no_body_has_is_refused_by_its_link(moments: str) -> None:
    with pytest.raises(RobotError, match=r"^link legs of the URDF: expected .* inertia .*") as caught:
        parse_robot(ASIMO.toml_text, changed(INERTIA, moments))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("link", ["head", "left_hand", "waist_yaw"])
def test_every_link_is_looked_at(link: str) -> None:
    body = f'<inertial><mass value="1"/><inertia {inertia(1, 2, 4)}/></inertial>'
    text = changed("</robot>", f'<link name="x">{body}</link>{FIXED.format(link, "x")}</robot>')
    with pytest.raises(RobotError, match=r"^link x of the URDF: expected the inertia of a body, .* found 1, 2, 4 kg"):
        parse_robot(ASIMO.toml_text, text)


FIXED = '<joint name="to_{1}" type="fixed"><parent link="{0}"/><child link="{1}"/></joint>'


@pytest.mark.parametrize(
    ("mass", "moments", "rpy"),
    [
        (10, inertia(0.1, 0.2, 0.3), "0.3 0.2 0.1"),  # flat
        (10, inertia(0.0, 0.2, 0.2), "0.3 0.2 0.1"),  # a rod
        (10, inertia(0.0, 0.0, 0.0), "0.3 0.2 0.1"),  # a point
        (0.001, inertia(1e-7, 2e-7, 3e-7), "1 2 3"),
        (1e4, inertia(1e3, 2e3, 3e3), "1 2 3"),
        (10, inertia(0.2, 0.3, 0.25, ixy=0.01, ixz=-0.02, iyz=0.03), "0 0 0"),
    ],
)
def test_an_inertia_at_the_edge_of_what_a_body_has_is_drakes_too(mass: float, moments: str, rpy: str) -> None:
    text = changed('<mass value="10"/>', f'<mass value="{mass}"/>').replace(INERTIA, moments)
    text = text.replace('<origin xyz="0 0 0.28"/>', f'<origin xyz="0 0 0.28" rpy="{rpy}"/>')
    moved = text.replace('<child link="legs"/>', '<child link="pole"/>').replace(
        "</robot>", f'<link name="pole"/>{FIXED.format("head", "legs")}</robot>'
    )
    moved = moved.replace('<parent link="legs"/>', '<parent link="pole"/>')
    robot = parse_robot(ASIMO.toml_text, moved)
    joints = DrakePlant(robot, step_ns=1_000_000)
    joints.finalize()
    context = joints.plant.CreateDefaultContext()
    joints.set_state(context, robot.comfort, np.zeros(len(robot.joints)))
    found = np.diagonal(joints.plant.CalcMassMatrix(context))[joints.v]
    np.testing.assert_allclose(found, Kinematics(robot).inertia_diagonal(robot.comfort), rtol=1e-9)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('<mass value="10"/>', "", "link legs .* expected <inertial> to hold <mass> and <inertia>, found no <mass>"),
        (f"<inertia {INERTIA}/>", "", "link legs .* found no <inertia>"),
        ('<mass value="10"/>', '<mass value="0"/>', "link legs .* no moments of inertia where the mass is 0"),
        ('<mass value="10"/>', '<mass value="1e9"/>', "link legs .* a mass of at most 100000 kg, found 1e"),
        ('lower="-0.08"', 'lower="-1e16"', r"joint hip_height .* lower=...> within 25 m of zero, found -1e\+16"),
        ('lower="-0.8"', 'lower="-1e16"', r"joint hip_yaw .* lower=...> within 25 rad of zero, found -1e\+16"),
        ('upper="0.05"', 'upper="26"', "joint hip_height .* upper=...> within 25 m of zero, found 26"),
        ('upper="0.05"', 'upper="-0.08"', "joint hip_height .* lower=...> below <limit upper=...>, found -0.08 and -0"),
        (
            'lower="-0.08" upper="0.05"',
            'lower="0" upper="1e-9"',
            "joint hip_height .* 1e-06 apart, found 1e-09",
        ),
        ('upper="0.05"', 'upper="-1"', "joint hip_height .* lower=...> below <limit upper=...>, found -0.08 and -1"),
        ('upper="0.05"', 'upper="nan"', "joint 'hip_height' .* 1 finite number, found 'nan'"),
        ('upper="0.05"', "", "joint hip_height of the URDF: expected <limit upper=...>, found none"),
        (
            '<limit lower="-0.08" upper="0.05" effort="2000" velocity="0.5"/>',
            "",
            "joint hip_height .* <limit lower=",
        ),
        ('effort="2000"', 'effort="0"', "joint hip_height .* expected <limit effort=...> above 0, found 0"),
        ('effort="2000"', 'effort="-5"', "joint hip_height .* expected <limit effort=...> above 0, found -5"),
        ('velocity="0.5"', 'velocity="-5"', "joint hip_height .* expected a velocity of at least 0, found -5"),
        ('type="prismatic"', 'type="continuous"', "joint hip_height .* revolute or prismatic .* found continuous"),
        ('type="prismatic"', 'type="floating"', "joint hip_height .* revolute or prismatic .* found floating"),
        ('type="prismatic"', 'type="planar"', "joint hip_height .* revolute or prismatic .* found planar"),
        ('<axis xyz="0 0 1"/>', '<axis xyz="0 0 0"/>', "joint hip_height .* expected an axis of length 1, found 0"),
        ('<axis xyz="0 0 1"/>', '<axis xyz="0 0 1"/><dynamics damping="-1"/>', "joint hip_height .* a damping of at"),
        ('<axis xyz="0 0 1"/>', '<axis xyz="0 0 1"/><mimic joint="hip_yaw"/>', "joint hip_height .* mimic 'hip_yaw'"),
        ('<axis xyz="0 0 1"/>', '<axis xyz="0 0 1"/><mimic multiplier="2"/>', "joint hip_height .* mimic ''"),
        ('xyz="0 0 0.28"', 'xyz="0 0 1e16"', "link 'legs' .* <origin xyz=...> to hold numbers from -1000 to 1000, f"),
        ('rgba="0.93 0.94 0.95 1"', 'rgba="0 0 0 2"', "material 'asimo_white' .* numbers from 0 to 1, found '0 0 0 2'"),
        ('<link name="pelvis">', '<link name="world_"/><link name="pelvis">', "expected one link that is no child"),
    ],
)
def test_what_no_robot_has_is_refused_by_name(
    old: str, new: str, message: str, capfd: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(RobotError, match=message) as caught:
        parse_robot(ASIMO.toml_text, changed(old, new))
    assert "\n" not in str(caught.value)
    assert capfd.readouterr() == ("", "")


def test_a_joint_that_is_to_mimic_another_is_refused_where_no_config_names_it() -> None:
    finger = FIXED.format("left_hand", "finger").replace('type="fixed"', 'type="prismatic"')
    finger = finger.replace("</joint>", '<mimic joint="left_elbow"/><limit effort="1" velocity="1"/></joint>')
    with pytest.raises(RobotError, match="joint to_finger of the URDF is to mimic 'left_elbow'"):
        parse_robot(ASIMO.toml_text, changed("</robot>", f'<link name="finger"/>{finger}</robot>'))


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('<link name="pelvis">', '<link name="pelvis"><visual><geometry/></visual>'),
        ('<link name="pelvis">', '<link name="pelvis"><collision><geometry/></collision>'),
        ('<link name="pelvis">', '<link name="pelvis"><visual/><collision/>'),
        ('<link name="pelvis">', '<link name="pelvis"><visual><geometry><cone size="1"/></geometry></visual>'),
        ('<link name="pelvis">', '<link name="pelvis"><visual><geometry><capsule radius="x"/></geometry></visual>'),
        ('<robot name="asimo">', '<robot name="asimo" version="7">'),
        ('<robot name="asimo">', '<robot name="asimo"><material/><material name="x"/><material name="asimo_grey"/>'),
        ('<material name="asimo_grey"/>', '<material name="unknown"/>'),
        ('<axis xyz="0 0 1"/>', '<axis xyz="0 0 1"/><dynamics/><calibration/><safety_controller/>'),
        ('<child link="legs"/>', '<child link="legs"/><axis/><limit effort="0" velocity="0"/>'),
    ],
)
def test_what_is_of_no_use_reaches_no_library(old: str, new: str, capfd: pytest.CaptureFixture[str]) -> None:
    robot = parse_robot(ASIMO.toml_text, changed(old, new))
    kinematics, simulation = Kinematics(robot), Simulation(robot)
    np.testing.assert_array_equal(simulation.hands(), Simulation(ASIMO).hands())
    np.testing.assert_array_equal(kinematics.hands(robot.comfort), Kinematics(ASIMO).hands(robot.comfort))
    RobotModel.load(robot.plain_urdf, robot.joints)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("root", ["base_link", "universe", "WorldModelInstance", "base", "world"])
def test_a_root_of_any_name_stands_on_the_ground(root: str) -> None:
    robot = parse_robot(ASIMO.toml_text, ASIMO.urdf_text.replace('"world"', f'"{root}"'))
    simulations = Simulation(robot), Simulation(ASIMO)
    for simulation in simulations:
        simulation.advance(robot.comfort + 0.01, 100_000_000)
    np.testing.assert_array_equal(simulations[0].positions, simulations[1].positions)
    assert simulations[0].link_poses()[-1].parent == simulations[1].link_poses()[-1].parent.replace("world", root)
    np.testing.assert_array_equal(Kinematics(robot).hands(robot.comfort), Kinematics(ASIMO).hands(robot.comfort))


def test_a_root_that_has_a_body_stands_on_the_ground() -> None:
    start = ASIMO.urdf_text.index('<joint name="world_to_legs"')
    joint = ASIMO.urdf_text[start : ASIMO.urdf_text.index("</joint>", start) + 8]
    robot = parse_robot(ASIMO.toml_text, ASIMO.urdf_text.replace(joint, "").replace('<link name="world"/>', ""))
    np.testing.assert_allclose(Simulation(robot).hands(), Simulation(ASIMO).hands(), atol=1e-12)


def test_another_link_is_not_the_world() -> None:
    text = ASIMO.urdf_text.replace('"world"', '"base_link"').replace('"pelvis"', '"world"')
    with pytest.raises(RobotError, match=r"link world of the URDF: expected it to be the .* which is base_link"):
        parse_robot(ASIMO.toml_text, text)


@pytest.mark.parametrize("name", ["head_pan", "left_elbow", "world_to_legs"])
@pytest.mark.parametrize("link", ["left_forearm", "head", "legs"])
def test_a_joint_may_be_called_as_a_link(name: str, link: str) -> None:
    old, new = f'joint name="{name}"', f'joint name="{link}"'
    text = ASIMO.urdf_text.replace(old, new)
    toml = ASIMO.toml_text.replace(f'name = "{name}"', f'name = "{link}"').replace(
        f'joint = "{name}"', f'joint = "{link}"'
    )
    robot = parse_robot(toml, text)
    np.testing.assert_allclose(Simulation(robot).hands(), Simulation(ASIMO).hands(), atol=1e-12)
    np.testing.assert_allclose(Kinematics(robot).hands(robot.comfort), Kinematics(ASIMO).hands(robot.comfort))
    RobotModel.load(robot.plain_urdf, robot.joints)


def test_frames_without_a_mass_are_let_through() -> None:
    """Links without <inertial>, and masses of zero where no joint moves them by themselves: models are full of them."""
    joint = '<joint name="{0}_stand" type="fixed"><parent link="head"/><child link="{0}"/></joint>'
    frame = joint + '<link name="{0}">{1}</link>'
    moments = " ".join(f'{axis}="0"' for axis in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"))
    weightless = f'<inertial><mass value="0"/><inertia {moments}/></inertial>'
    text = changed("</robot>", frame.format("camera", "") + frame.format("lens", weightless) + "</robot>")
    robot = parse_robot(ASIMO.toml_text, text)
    np.testing.assert_array_equal(
        Kinematics(robot).inertia_diagonal(robot.comfort), Kinematics(ASIMO).inertia_diagonal(ASIMO.comfort)
    )


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('xyz="0 0 0.28"', 'xyz="  0  +0.  .28e0 "'),
        ('<mass value="10"/>', '<mass value="1E+1"/>'),
        ("</robot>", "<gazebo><mass value='any'/></gazebo></robot>"),
    ],
)
def test_what_the_libraries_read_is_let_through(old: str, new: str, capfd: pytest.CaptureFixture[str]) -> None:
    robot = parse_robot(ASIMO.toml_text, changed(old, new))
    assert Kinematics(robot).inertia_diagonal(ASIMO.comfort).tolist() == pytest.approx(
        Kinematics(ASIMO).inertia_diagonal(ASIMO.comfort).tolist(), rel=1e-15
    )
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (" \n", "robot description: expected the text of a URDF, found none"),
        (
            changed("<link", '<x:arm xmlns:x="http://www.ros.org/wiki/xacro"/><link'),
            "macros; expand it with xacro first",
        ),
        (changed("An ASIMO", "\ud800"), r"expected UTF-8 text, found '\\ud800'"),
        (changed("</robot>", "<a>" * 20_000 + "</a>" * 20_000 + "</robot>"), "at most 64 deep"),
        (changed("</robot>", "<a/>" * 100_000 + "</robot>"), "at most 100000 elements"),
        (changed("</robot>", " " * 2**24 + "</robot>"), "at most 4194304 bytes"),
        ("<" + "a" * 10_000 + "/>", "expected the root element 'robot', found 'aaaa"),
        (
            "<!DOCTYPE r [<!ENTITY a '" + "b" * 9999 + "'>]><robot>" + "&a;" * 9999 + "</robot>",
            "not XML: limit on input",
        ),
    ],
    ids=["empty", "macros", "surrogate", "deep", "many", "large", "long name", "entities"],
)
@pytest.mark.parametrize("read", [parse_urdf, canonical_urdf, joint_links])
def test_hostile_text_is_one_clear_error(read, text: str, message: str) -> None:
    with pytest.raises(RobotError, match=message) as caught:
        read(text)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 300


def test_many_hostile_links_do_not_fill_the_message() -> None:
    joint = '<joint name="{0}" type="fixed"><parent link="world"/><child link="{0}"/></joint><link name="{0}"/>'
    links = "".join(joint.format(f"{number:0100d}") for number in range(900))
    text = ASIMO.urdf_text.replace("left_hand", "left_fist").replace("</robot>", links + "</robot>")
    with pytest.raises(RobotError, match="frames left_hand of the robot config are not links") as caught:
        parse_robot(ASIMO.toml_text, text)
    assert len(str(caught.value)) < 1200
