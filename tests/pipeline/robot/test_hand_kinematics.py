"""Our own kinematics of the hands is Pinocchio's to the last digits, and has bits of its own."""

import hashlib
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pinocchio
import pytest

from pipeline.arrays import Floats
from pipeline.robot.config import RobotConfig, load_robot, parse_robot, robot_names
from pipeline.robot.hand_kinematics import HandKinematics
from pipeline.robot.pinocchio_model import build_model, joint_index, link_frame
from pipeline.urdf.description import canonical
from recorders.errors import ConfigError, JointError


def postures(robot: RobotConfig, count: int) -> Floats:
    drawn: Floats = np.random.default_rng(0).uniform(robot.lower, robot.upper, (count, len(robot.joints)))
    return drawn


def askew(robot: RobotConfig) -> RobotConfig:
    """Return the robot with every axis and origin turned, of fixed joints too, and axes that are not of length 1."""
    urdf, numbers = ElementTree.fromstring(robot.urdf_text), np.random.default_rng(1)  # our own file
    for joint in urdf.iterfind("joint"):
        for tag, attribute in (("origin", "rpy"), ("axis", "xyz")):
            if (element := joint.find(tag)) is not None:
                element.set(attribute, " ".join(f"{number:.6f}" for number in numbers.uniform(-0.6, 0.6, 3)))
    return parse_robot(robot.toml_text, ElementTree.tostring(urdf, encoding="unicode"), origin="askew")


@pytest.mark.parametrize("turn", [lambda robot: robot, askew], ids=["as-it-is", "askew"])
@pytest.mark.parametrize("name", robot_names())
def test_hands_are_where_pinocchio_has_them(name: str, turn: type) -> None:
    robot = turn(load_robot(name))
    model = build_model(canonical(robot.urdf_text))
    data, theirs = model.createData(), pinocchio.neutral(model)
    places = [model.joints[joint_index(model, joint)].idx_q for joint in robot.joints]
    drawn = postures(robot, 50)
    positions, rotations = HandKinematics(robot).poses(drawn)
    assert (positions.shape, rotations.shape) == ((50, len(robot.hands), 3), (50, len(robot.hands), 3, 3))
    for k, q in enumerate(drawn):
        theirs[places] = q
        pinocchio.framesForwardKinematics(model, data, theirs)
        for hand, position, rotation in zip(robot.hands, positions[k], rotations[k], strict=True):
            placement = data.oMf[link_frame(model, hand.link)]
            np.testing.assert_allclose(position, placement.translation, rtol=0, atol=1e-14)
            np.testing.assert_allclose(rotation, placement.rotation, rtol=0, atol=1e-14)


def test_one_posture_has_the_bits_that_it_has_among_many() -> None:
    robot = load_robot("asimo")
    kinematics, drawn = HandKinematics(robot), postures(robot, 30)
    positions, rotations = kinematics.poses(drawn)
    assert kinematics.positions(drawn).tobytes() == positions.tobytes()
    assert kinematics.positions(drawn.reshape(5, 6, -1)).tobytes() == positions.tobytes()
    for k, q in enumerate(drawn):
        alone = kinematics.poses(q)
        assert kinematics.positions(q).tobytes() == alone[0].tobytes() == positions[k].tobytes()
        assert alone[1].tobytes() == rotations[k].tobytes()


def test_a_joint_without_limits_turns_as_one_that_has_them() -> None:
    robot = load_robot("asimo")
    free = replace(robot, urdf_text=robot.urdf_text.replace('type="revolute"', 'type="continuous"'))
    assert free.urdf_text != robot.urdf_text
    drawn = postures(robot, 5)
    assert HandKinematics(free).positions(drawn).tobytes() == HandKinematics(robot).positions(drawn).tobytes()


def test_their_bits_are_these() -> None:
    """Every operation is one that IEEE 754 fixes, in an order that is fixed here."""
    robot = load_robot("asimo")
    waves = (np.arange(2000.0) % 16 - 8) / 64.0
    poses = HandKinematics(robot).poses(robot.comfort + waves[:, np.newaxis] * np.arange(len(robot.joints)))
    digest = hashlib.sha256(b"".join(part.astype("<f8").tobytes() for part in poses)).hexdigest()
    assert digest[:16] == "b5e5f382c4983463"


def test_postures_that_cannot_be_the_robots_are_refused() -> None:
    robot = load_robot("asimo")
    with pytest.raises(JointError, match="expected postures of 15 joints, found an array of shape"):
        HandKinematics(robot).positions(robot.comfort[:-1])
    with pytest.raises(ConfigError, match="expected angles within"):
        HandKinematics(robot).poses(np.full(15, np.nan))
