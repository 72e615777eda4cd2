"""Robots come from two files; anything that does not make a usable robot is one clear error."""

import os
from xml.etree import ElementTree

import numpy as np
import pytest

from pipeline.robot.config import RobotConfig, load_robot, parse_robot, robot_names
from recorders.errors import RobotError


@pytest.fixture(scope="module")
def asimo() -> RobotConfig:
    return load_robot("asimo")


def test_asimo_is_the_robot_of_the_paper(asimo: RobotConfig) -> None:
    assert len(asimo.joints) == 15
    assert sum(name.startswith("hip_") for name in asimo.joints) == 4
    assert sum(name.startswith("left_") for name in asimo.joints) == 5
    assert sum(name.startswith("right_") for name in asimo.joints) == 5
    np.testing.assert_allclose(asimo.input_centre, [0.32, 0.20, 0.76, 0.32, -0.20, 0.76])
    assert (asimo.lower < asimo.comfort).all()
    assert (asimo.comfort < asimo.upper).all()


def test_asimo_weighs_about_32_kg_and_every_joint_has_a_motor(asimo: RobotConfig) -> None:
    urdf = ElementTree.fromstring(asimo.urdf_text)
    assert sum(float(mass.get("value", "")) for mass in urdf.iter("mass")) == pytest.approx(32.2)
    assert {joint.get("name") for joint in urdf.iterfind("transmission/joint")} == set(asimo.joints)


def test_asimo_is_the_same_on_both_sides(asimo: RobotConfig) -> None:
    urdf = ElementTree.fromstring(asimo.urdf_text)
    left = {link.get("name", ""): link for link in urdf.iterfind("link") if link.get("name", "").startswith("left_")}
    for name, link in left.items():
        other = urdf.find(f"link[@name='{name.replace('left_', 'right_')}']")
        assert other is not None
        for mine, its in zip(link.iter("mass"), other.iter("mass"), strict=True):
            assert mine.attrib == its.attrib
        for mine, its in zip(link.iter("inertia"), other.iter("inertia"), strict=True):
            assert mine.attrib == its.attrib


def test_a_robot_is_immutable(asimo: RobotConfig) -> None:
    with pytest.raises(ValueError, match="read-only"):
        asimo.comfort[0] = 1.0


def test_a_robot_comes_back_from_its_own_texts(asimo: RobotConfig) -> None:
    again = parse_robot(asimo.toml_text, asimo.urdf_text)
    assert again.joints == asimo.joints
    np.testing.assert_array_equal(again.comfort, asimo.comfort)


def test_a_robot_comes_from_a_directory(asimo: RobotConfig, tmp_path) -> None:
    (tmp_path / "robot.toml").write_text(asimo.toml_text.replace('name = "asimo"', 'name = "mine"'))
    (tmp_path / "robot.urdf").write_text(asimo.urdf_text)
    assert load_robot(tmp_path).name == "mine"


def test_an_unknown_robot_is_refused_with_those_that_exist() -> None:
    with pytest.raises(RobotError, match=r"unknown robot 'r2d2'.*asimo"):
        load_robot("r2d2")
    assert "asimo" in robot_names()


def test_a_urdf_in_place_of_a_folder_is_refused_with_what_makes_one_of_it(tmp_path) -> None:
    urdf = tmp_path / "arm.urdf"
    urdf.write_text("<robot/>")
    with pytest.raises(RobotError, match=r"found a file; `reenact robot new .*arm\.urdf --hand LINK --out DIR` makes"):
        load_robot(urdf)


def test_a_directory_without_robot_files_is_refused(tmp_path) -> None:
    with pytest.raises(RobotError, match=r"cannot read robot file .*robot\.toml"):
        load_robot(tmp_path)
    (tmp_path / "robot.toml").write_bytes(b"\xff\xfe")
    with pytest.raises(RobotError, match="UTF-8"):
        load_robot(tmp_path)


@pytest.mark.parametrize(
    ("file", "kept", "message"),
    [
        ("robot.urdf", 0, "robot description: expected the text of a URDF, found none"),
        ("robot.urdf", 5000, "robot description is not XML"),
        ("robot.toml", 0, "the robot config lacks"),
    ],
)
def test_a_cut_off_file_is_refused_with_its_folder(
    asimo: RobotConfig, tmp_path, file: str, kept: int, message: str
) -> None:
    (tmp_path / "robot.toml").write_text(asimo.toml_text)
    (tmp_path / "robot.urdf").write_text(asimo.urdf_text)
    os.truncate(tmp_path / file, kept)
    with pytest.raises(RobotError, match=message) as caught:
        load_robot(tmp_path)
    assert str(caught.value).startswith(f"robot '{tmp_path}': ")
    assert is_one_short_line(caught.value)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('name = "asimo"', "", "lacks name"),
        ('name = "asimo"', 'name = "asimo"\ncolour = "red"', "unknown colour"),
        ('name = "asimo"', "name = 7", "name of the robot config: expected a name, found 7"),
        ('name = "asimo"', 'name = "asimo', "expected TOML"),
        ('link = "left_hand"', "", "hand left lacks link"),
        ('link = "left_hand"', 'link = "left_claw"', "left_claw of the robot config are not links"),
        (
            'name = "left"',
            'name = "/left"',
            r"name of hand number 1 .* expected small letters, digits and '_', .* found '/left'",
        ),
        ('name = "left"', 'name = "right"', "hands of the robot config: right given more than once"),
        (
            'controls = "position"',
            'controls = "force"',
            'controls of hand left .* expected "position" or "pose", found \'force\'',
        ),
        ('controls = "position"', 'controls = "pose"', "centre of hand left .* expected seven numbers, found a list"),
        ("box = [0.069,", "box = [0.0,", r"box of hand left .* expected half extents above 0 and at most 10 m"),
        ("box = [0.069,", "box = [69,", r"box of hand left .* expected half extents above 0 and at most 10 m"),
        ('joint = "head_pan"', 'joint = "neck"', r"\[gaze\] joint 'neck' is not among"),
        ("weight = 0.1,", "weigth = 0.1,", "joint hip_height lacks weight, and has unknown weigth: expected the keys"),
        ("weight = 0.1,", "", "joint hip_height lacks weight: expected"),
        ("weight = 0.1,", "weight = 0.0,", "weight of hip_height .* above 0"),
        ("weight = 0.1,", "weight = nan,", "weight of hip_height .* finite number"),
        ("weight = 0.1,", "weight = true,", "weight of hip_height .* finite number"),
        ("centre = [0.32,", "centre = [32,", r"centre of hand left .* within 10 m of zero, found 32"),
        ("comfort = -0.3", "comfort = 9.0", "comfort of left_shoulder_pitch: expected between"),
        ('name = "hip_yaw"', 'name = "hip_roll"', "hip_roll given more than once"),
        ('name = "hip_yaw"', 'name = "knee"', r"joints knee of the robot config are not movable joints of the URDF"),
        ("up = [0.0, 0.0, 1.0]", "up = [0.0, 0.0, 2.0]", r"up .* expected length 1, found 2"),
        ("up = [0.0, 0.0, 1.0]", "up = [0.0, 1.0, 0.0]", "up at right angles to lateral, found cosine 1"),
        ("up = [0.0, 0.0, 1.0]", "up = [0.0, 1.0]", r"up .* expected three numbers"),
        ("[pattern]", "[pattern.deep]", r"\[pattern\] lacks"),
    ],
)
def test_a_wrong_config_is_one_clear_error(asimo: RobotConfig, old: str, new: str, message: str) -> None:
    text = asimo.toml_text.replace(old, new, 1)
    assert text != asimo.toml_text
    with pytest.raises(RobotError, match=message) as caught:
        parse_robot(text, asimo.urdf_text)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("</robot>", "", "not XML"),
        ("<robot ", "<sdf ", "not XML"),
        ('<joint name="hip_yaw" type="revolute">', '<joint name="hip_yaw" type="fixed">', "hip_yaw .* not movable"),
        ('lower="-0.8"', 'lower="low"', "joint 'hip_yaw' .* <limit lower=...> to hold 1 finite number, found 'low'"),
        ('lower="-0.8"', "", "joint hip_yaw .* expected <limit lower"),
        ('<joint name="hip_yaw"><hard', '<joint name="hip_jaw"><hard', "joints hip_yaw .* no transmission"),
    ],
)
def test_a_wrong_urdf_is_one_clear_error(asimo: RobotConfig, old: str, new: str, message: str) -> None:
    text = asimo.urdf_text.replace(old, new, 1)
    assert text != asimo.urdf_text
    with pytest.raises(RobotError, match=message):
        parse_robot(asimo.toml_text, text)


def test_a_document_that_is_not_a_robot_is_refused(asimo: RobotConfig) -> None:
    with pytest.raises(RobotError, match="expected the root element 'robot', found 'sdf'"):
        parse_robot(asimo.toml_text, "<sdf/>")


def test_a_movable_joint_that_the_config_leaves_out_is_refused(asimo: RobotConfig) -> None:
    rows = [line for line in asimo.toml_text.splitlines() if '"left_wrist"' not in line]
    with pytest.raises(RobotError, match="movable joints left_wrist of the URDF are not in the robot config"):
        parse_robot("\n".join(rows), asimo.urdf_text)


def is_one_short_line(error: RobotError) -> bool:
    return "\n" not in str(error) and len(str(error)) < 2500 and str(error).isprintable()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a = " + "[" * 20_000, "nested at most 16 deep"),
        ("a = " + "9" * 5_000, "expected TOML, found an integer of too many digits"),
        ("\ud800 = 1", r"expected UTF-8 text, found '\\ud800'"),
        ("# " + "a" * 2**24, "expected at most 32768 bytes"),
        (".".join("a" * 4_000) + " = 1", "nested at most 16 deep"),
        ('"a\\nb" = 1', "lacks hands"),
    ],
    ids=["deep", "long integer", "surrogate", "large", "deep table", "key of two lines"],
)
def test_hostile_config_is_one_clear_error(asimo: RobotConfig, text: str, message: str) -> None:
    with pytest.raises(RobotError, match=message) as caught:
        parse_robot(text, asimo.urdf_text)
    assert is_one_short_line(caught.value)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("weight = 0.1,", "weight = " + "1" * 400 + ",", "weight of hip_height .* finite number"),
        (
            "weight = 0.1,",
            "weight = 0x" + "f" * 20_000 + ",",
            "weight of hip_height .* finite number, found a whole number, a huge one",
        ),
        ('name = "asimo"', 'name = "as\\nimo"', r"expected a name, found 'as\\nimo'"),
        ('name = "asimo"', f'name = "{"a" * 10_000}"', "expected a name, found 'aaa"),
        ('name = "asimo"', "name." + ".".join("a" * 10) + " = 1", "expected a name, found a table of 1"),
        ('name = "asimo"', 'name = "asimo"\n"a\\nb" = 1\n' + "b" * 10_000 + " = 1", "unknown a b, bbb"),
    ],
    ids=["400 digits", "20,000 digits", "two lines", "long", "deep", "unknown keys"],
)
def test_hostile_values_are_one_clear_error(asimo: RobotConfig, old: str, new: str, message: str) -> None:
    with pytest.raises(RobotError, match=message) as caught:
        parse_robot(asimo.toml_text.replace(old, new, 1), asimo.urdf_text)
    assert is_one_short_line(caught.value)


def test_a_huge_file_is_refused(asimo: RobotConfig, tmp_path) -> None:
    (tmp_path / "robot.toml").touch()
    os.truncate(tmp_path / "robot.toml", 2**26)
    (tmp_path / "robot.urdf").write_text(asimo.urdf_text)
    with pytest.raises(RobotError, match="robot config: expected at most"):
        load_robot(tmp_path)
