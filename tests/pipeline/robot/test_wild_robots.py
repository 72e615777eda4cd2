"""Models of robots as their makers publish them are imported as they are, or refused for what they really have."""

import importlib.metadata
import re
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pinocchio
import pytest

from pipeline.robot.config import RobotConfig, load_robot, parse_robot
from pipeline.robot.kinematics import Kinematics
from pipeline.simulation.servos import DrakePlant
from recorders.errors import RobotError
from recorders.rerun_scene.robot import RobotModel

PACKAGE = "example-robot-data"
FILES = {
    file.as_posix(): Path(str(file.locate()))
    for file in importlib.metadata.files(PACKAGE) or []
    if file.suffix == ".urdf"
}
SOME = ("panda", "so100", "z1", "anymal_c_simple_description/urdf/anymal", "kinova", "pr2", "ur5_robot", "ur3")
SUBSET = [name for name in FILES if name.removesuffix(".urdf").endswith(tuple(f"/{end}" for end in SOME))]

PATTERN = """
[pattern]
left_centre = [0.4, 0.2, 0.4]
right_centre = [0.4, -0.2, 0.4]
lateral = [0.0, 1.0, 0.0]
up = [0.0, 0.0, 1.0]
"""


@dataclass(frozen=True)
class Model:
    """A URDF, read without the program."""

    name: str
    root: ElementTree.Element

    @classmethod
    def read(cls, name: str) -> "Model":
        return cls(name, ElementTree.parse(FILES[name]).getroot())

    @property
    def joints(self) -> dict[str, ElementTree.Element]:
        return {joint.get("name", ""): joint for joint in self.root.iterfind("joint")}

    def link(self, name: str) -> ElementTree.Element:
        (link,) = (link for link in self.root.iterfind("link") if link.get("name") == name)
        return link

    def limits(self, name: str) -> tuple[float, float] | None:
        """Limits between which a joint moves, if it does."""
        joint, limit = self.joints[name], self.joints[name].find("limit")
        if joint.get("type") not in ("revolute", "prismatic") or limit is None:
            return None
        lower, upper = (float(limit.get(side, "0")) for side in ("lower", "upper"))
        return (lower, upper) if lower < upper else None

    def mimic(self, name: str) -> tuple[str, float, float] | None:
        mimic = self.joints[name].find("mimic")
        if mimic is None or self.joints[name].get("type") == "fixed":
            return None
        return mimic.get("joint", ""), float(mimic.get("multiplier", "1")), float(mimic.get("offset", "0"))

    def child(self, name: str) -> str:
        child = self.joints[name].find("child")
        assert child is not None
        return child.get("link", "")

    def moving(self, *, leaders: bool) -> list[str]:
        """Joints that a robot may have; with or without those that others mimic."""
        led = {mimic[0] for name in self.joints if (mimic := self.mimic(name))}
        return [
            name for name in self.joints if self.limits(name) and not self.mimic(name) and (leaders or name not in led)
        ]

    def inertia(self, name: str) -> np.ndarray:
        (element,) = self.link(name).iterfind("inertial/inertia")
        xx, xy, xz, yy, yz, zz = (float(element.get(key, "0")) for key in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"))
        return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def write(model: Model, joints: list[str], folder: Path, *, as_it_is: bool = False) -> Path:
    """Write a robot of some of a model's joints, each with its comfort in the middle."""
    folder.mkdir()
    limits = {name: model.limits(name) or (-1.0, 1.0) for name in joints if name in model.joints}
    rows = [
        f'{{ name = "{name}", weight = 1.0, comfort = {sum(limits.get(name, (0.0, 0.0))) / 2} }}' for name in joints
    ]
    ends = [model.child(name) for name in joints if name in model.joints] or ["none"]
    hands = f'[hands]\nleft = "{ends[0]}"\nright = "{ends[-1]}"\n[gaze]\njoint = "{joints[0]}"\nframe = "{ends[0]}"\n'
    (folder / "robot.toml").write_text(f'name = "wild"\njoints = [{", ".join(rows)}]\n{hands}{PATTERN}')
    if as_it_is:
        (folder / "robot.urdf").write_bytes(FILES[model.name].read_bytes())
        return folder
    frozen = "".join(f'"{name}" = {value}\n' for name, value in stiff(model, joints).items())
    source = f'[source]\npackage = "{PACKAGE}"\nurdf = "{model.name}"\n[frozen]\n{frozen}'
    (folder / "import.toml").write_text(source)
    return folder


def stiff(model: Model, joints: list[str]) -> dict[str, float]:
    """Where joints stand that cannot stand at 0."""
    others = {name: model.limits(name) for name in model.joints if name not in joints and not model.mimic(name)}
    return {name: sum(ends) / 2 for name, ends in others.items() if ends and not ends[0] <= 0.0 <= ends[1]}


def check_imported(model: Model, joints: list[str], robot: RobotConfig) -> None:
    """Check that the hands are where the whole model has them, and that the simulation has the same masses."""
    whole = pinocchio.buildModelFromUrdf(str(FILES[model.name]))
    data, q = whole.createData(), np.random.default_rng(1).uniform(robot.lower, robot.upper)
    posture = dict.fromkeys(model.joints, 0.0) | stiff(model, joints) | dict(zip(robot.joints, q, strict=True))
    configuration = pinocchio.neutral(whole)
    for name in model.joints:
        value, followed = posture[name], name
        factor, offset = 1.0, 0.0
        while mimic := model.mimic(followed):
            followed, multiplier, more = mimic
            offset, factor = factor * more + offset, factor * multiplier
            value = factor * posture[followed] + offset
        if whole.existJointName(name) and whole.joints[whole.getJointId(name)].nq == 1:
            configuration[whole.joints[whole.getJointId(name)].idx_q] = value
    pinocchio.framesForwardKinematics(whole, data, configuration)
    frames = [whole.getFrameId(hand, pinocchio.FrameType.BODY) for hand in (hand.link for hand in robot.hands)]
    expected = [data.oMf[frame].translation for frame in frames]
    kinematics = Kinematics(robot)
    np.testing.assert_allclose(kinematics.hands(q), expected, atol=1e-9)
    joint_space = DrakePlant(robot, step_ns=1_000_000)
    joint_space.finalize()
    context = joint_space.plant.CreateDefaultContext()
    joint_space.set_state(context, q, np.zeros(len(q)))
    masses = np.diagonal(joint_space.plant.CalcMassMatrix(context))[joint_space.v]
    np.testing.assert_allclose(masses, kinematics.inertia_diagonal(q), rtol=1e-7, atol=1e-12)
    RobotModel.load(robot.plain_urdf, robot.joints)


def check_reason(model: Model, joints: list[str], reason: str) -> None:
    """Check that the model really has what it is refused for."""
    assert "\n" not in reason
    if found := re.search(r"link (\S+) of the URDF: expected the inertia of a body", reason):
        low, middle, high = np.linalg.eigvalsh(model.inertia(found[1]))
        assert low < 0.0 or low + middle < high, reason
    elif found := re.search(r"link (\S+) of the URDF: expected no moments of inertia where the mass is 0", reason):
        (mass,) = model.link(found[1]).iterfind("inertial/mass")
        assert float(mass.get("value", "")) == 0.0
        assert model.inertia(found[1]).any()
    elif found := re.search(r"joint (\S+) of the model is to mimic '?(\w+)'?, which is among the robot's", reason):
        assert (model.mimic(found[1]) or ("",))[0] == found[2]
        assert found[2] in joints
    elif found := re.search(r"joint (\S+) of the URDF is to mimic '(\w+)'", reason):
        assert (model.mimic(found[1]) or ("",))[0] == found[2]
    elif found := re.search(r"joint (\S+) of the (model|URDF): expected <limit (lower|effort)=", reason):
        limit = model.joints[found[1]].find("limit")
        assert limit is None or not model.limits(found[1]) or not float(limit.get("effort", "0")) > 0.0
    elif "are not movable joints of the" in reason:
        assert joints == ["none"]
    elif found := re.search(r"joint (\S+) of the URDF: expected a revolute or prismatic one, .* found (\w+)", reason):
        assert model.joints[found[1]].get("type") == found[2]
    elif found := re.search(r"joints (\S+?),? .*of the URDF have no transmission", reason):
        motors = [motor for motor in model.root.iterfind("transmission") if "Simple" in motor.findtext("type", "")]
        assert found[1] not in {joint.get("name") for motor in motors for joint in motor.iterfind("joint")}
    elif found := re.search(r"movable joints (\S+?),? .*of the URDF are not in the robot config", reason):
        assert model.joints[found[1]].get("type") != "fixed"
        assert found[1] not in joints
    elif found := re.search(r"link (\S+) of the URDF: expected a mass above 0, as a joint moves it", reason):
        (mass,) = model.link(found[1]).iterfind("inertial/mass")
        assert float(mass.get("value", "")) == 0.0
    else:
        assert "name of the URDF: expected a name, found" in reason
        assert model.root.get("name") is None


def loaded(folder: Path, reasons: dict[str, str], way: str) -> RobotConfig | None:
    try:
        return load_robot(folder)
    except RobotError as error:
        reasons[way] = str(error)
        return None


def check(name: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> dict[str, str]:
    """Try a model in three ways; return the reasons for which it was refused."""
    model = Model.read(name)
    reasons: dict[str, str] = {}
    for way, joints in (
        ("all joints", model.moving(leaders=True)),
        ("no leaders", model.moving(leaders=False)),
        ("as it is", model.moving(leaders=True)),
    ):
        joints = joints or [joint for joint in model.joints if model.joints[joint].get("type") != "fixed"] or ["none"]
        folder = write(model, joints, tmp_path / way, as_it_is=way == "as it is")
        if (robot := loaded(folder, reasons, way)) is None:
            check_reason(model, joints, reasons[way])
        else:
            check_imported(model, joints, robot)
            assert parse_robot(robot.toml_text, robot.urdf_text).joints == robot.joints
        assert capfd.readouterr() == ("", "")
    return reasons


@pytest.mark.parametrize("name", SUBSET)
def test_a_few_models(name: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    reasons = check(name, tmp_path, capfd)
    if re.search("panda|so100|z1|kinova|ur5|pr2", name):
        assert ("no leaders" in reasons) == name.endswith("pr2.urdf")  # two of its links are no bodies


@pytest.mark.campaign
@pytest.mark.parametrize("name", sorted(FILES.keys() - set(SUBSET)))
def test_every_model(name: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    check(name, tmp_path, capfd)


def test_most_models_are_imported() -> None:
    assert len(FILES) > 60
    assert len(SUBSET) == len(SOME)
