"""A URDF is read the same whatever its order; what libraries would drop or complain about is refused in one line."""

import random
from xml.etree import ElementTree

import numpy as np
import pytest

from pipeline.kinematics import Kinematics
from pipeline.robot import load_robot, parse_robot
from pipeline.urdf import canonical_urdf, joint_links, parse_urdf
from recorders.errors import RobotError

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
        ('<link name="pelvis">', "<link>", "name of a link of the URDF: expected a name, found None"),
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
        (changed("An ASIMO", "\ud800"), r"expected UTF-8 text, found '\\ud800'"),
        (changed("</robot>", "<a>" * 20_000 + "</a>" * 20_000 + "</robot>"), "at most 64 deep"),
        (changed("</robot>", "<a/>" * 100_000 + "</robot>"), "at most 100000 elements"),
        (changed("</robot>", " " * 2**24 + "</robot>"), "at most 16777216 bytes"),
        ("<" + "a" * 10_000 + "/>", "expected the root element 'robot', found 'aaaa"),
        (
            "<!DOCTYPE r [<!ENTITY a '" + "b" * 9999 + "'>]><robot>" + "&a;" * 9999 + "</robot>",
            "not XML: limit on input",
        ),
    ],
    ids=["empty", "surrogate", "deep", "many", "large", "long name", "entities"],
)
@pytest.mark.parametrize("read", [parse_urdf, canonical_urdf, joint_links])
def test_hostile_text_is_one_clear_error(read, text: str, message: str) -> None:
    with pytest.raises(RobotError, match=message) as caught:
        read(text)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 300


def test_many_hostile_links_do_not_fill_the_message() -> None:
    joint = '<joint name="{0}" type="fixed"><parent link="world"/><child link="{0}"/></joint><link name="{0}"/>'
    links = "".join(joint.format(f"{number:0100d}") for number in range(1000))
    text = ASIMO.urdf_text.replace("left_hand", "left_fist").replace("</robot>", links + "</robot>")
    with pytest.raises(RobotError, match="frames left_hand of the robot config are not links") as caught:
        parse_robot(ASIMO.toml_text, text)
    assert len(str(caught.value)) < 1200
