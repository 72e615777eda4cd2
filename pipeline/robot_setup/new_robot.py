"""Makes a robot of a URDF: its joints, comfort posture, centres and boxes, and the folder that holds them."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from pipeline.arrays import Floats
from pipeline.robot.config import IMPORT_FILE, TOML_FILE, RobotConfig, load_robot, parse_robot
from pipeline.robot.hand_kinematics import HandKinematics
from pipeline.robot.importing.import_spec import (
    JointLimits,
    Pose,
    RobotSource,
    package_file,
    read_source,
    read_text,
)
from pipeline.robot.importing.urdf_import import import_urdf
from pipeline.robot.kinematics import Kinematics
from pipeline.robot_setup.box import BoxSearch
from pipeline.robot_setup.comfort import Comfort
from pipeline.robot_setup.folder_texts import AHEAD, import_toml, robot_toml
from pipeline.robot_setup.model_joints import ModelJoint, model_joints, rigid_positions
from pipeline.robot_setup.reach import Reach, manipulability_of, sample_reach
from pipeline.robot_setup.statics import Statics
from pipeline.rotations import quaternions_of_matrices
from pipeline.urdf.description import parse_urdf
from recorders.errors import RobotError
from recorders.files import disk
from recorders.files.anonymous_file import write_whole
from recorders.text.wording import names_text

MODEL_FILE = "model.urdf"

_ANY_BOX = np.full(3, 0.1)


@dataclass(frozen=True)
class RobotRequest:
    """What is known of a robot before anything is found.

    Attributes
    ----------
    urdf : str
        Path of its URDF, or the URDF's place among the files of `package`.
    hands : mapping of str to str
        Links of the hands, by name.
    name : str
        Name of the robot.
    package : str or None
        Installed Python package that brings the URDF, which is then not copied.
    limits : tuple of (str, JointLimits)
        Limits by joint or pattern of joints.
    rigid : mapping of str to float
        Joints that are not to move, and where they stay [rad or m].
    drop : tuple of str
        Joints that are left out with all that hangs on them.
    height_m : float
        Height of the model's root above the ground [m].
    pose : bool
        Whether the poses of the hands are controlled, not their positions alone.
    seed : int
        Seed of the samples.
    """

    urdf: str
    hands: Mapping[str, str]
    name: str
    package: str | None = None
    limits: tuple[tuple[str, JointLimits], ...] = ()
    rigid: Mapping[str, float] = field(default_factory=dict)
    drop: tuple[str, ...] = ()
    height_m: float = 0.0
    pose: bool = False
    seed: int = 0

    def __post_init__(self) -> None:
        if not math.isfinite(self.height_m):
            raise RobotError(f"height of the model's root: expected a finite number, found {self.height_m}")


@dataclass(frozen=True, eq=False)
class NewRobot:
    """A robot that was made, and how it was found.

    Attributes
    ----------
    config : RobotConfig
        The robot.
    source : RobotSource
        What of the model it is made of.
    joints : tuple of ModelJoint
        Its joints as the model has them.
    reach : Reach
        Samples of its reach.
    texts : mapping of str to str
        Its files, by name.
    """

    config: RobotConfig
    source: RobotSource
    joints: tuple[ModelJoint, ...]
    reach: Reach
    texts: Mapping[str, str]

    @cached_property
    def freedom(self) -> Floats:
        """Manipulability of each hand in the comfort posture, in parts of the largest of all samples, (hands,)."""
        _, jacobian = Kinematics(self.config).hands_and_jacobian(self.config.comfort)
        freedom: Floats = manipulability_of(jacobian) / self.reach.manipulability.max(axis=0)
        return freedom

    def write(self, folder: Path, *, overwrite: bool = False) -> RobotConfig:
        """Write the robot's files and return the robot that is read from them.

        Raises
        ------
        RobotError
            The folder holds a robot, and may not be overwritten, or it cannot be written.
        """
        check_folder(folder, overwrite=overwrite)
        try:
            disk.make_folders(folder)
            for name, text in self.texts.items():
                write_whole(folder / name, text.encode())
        except OSError as error:
            raise RobotError(f"{folder}: cannot be written: {error.strerror or error}") from error
        return load_robot(folder.resolve())


def check_folder(folder: Path, *, overwrite: bool) -> None:
    """Check that a robot's files can be written to a folder; raises RobotError."""
    if folder.exists() and not folder.is_dir():
        raise RobotError(f"{folder}: expected a folder, found a file; choose another place")
    if (folder / TOML_FILE).exists() and not overwrite:
        raise RobotError(f"{folder}: there is a robot in this folder already; --overwrite replaces its files")


def make_robot(request: RobotRequest) -> NewRobot:
    """Make a robot from a URDF: choose its joints, sample its reach, find comfort posture, centres and boxes.

    Raises
    ------
    RobotError
        The URDF is none, a hand or a joint is not in it, joints have no limits, or no posture or box is found.
    """
    source = _source(request)
    model_text = read_source(source, Path()) if request.package else read_text(Path(request.urdf))
    try:
        urdf = parse_urdf(model_text)
    except RobotError as error:
        raise RobotError(f"{request.urdf}: {error}") from error
    joints = model_joints(
        urdf, request.hands, limits=request.limits, rigid=list(request.rigid), least=6 if request.pose else 3
    )
    names = [joint.name for joint in joints]
    source = _completed(source, joints, rigid_positions(urdf, names, request.rigid, request.drop))
    urdf_text = import_urdf(
        model_text,
        source,
        name=request.name,
        joints=names,
        frames=list(request.hands.values()),
        hands={link: hand for hand, link in request.hands.items()},
    )
    config, reach = _found(request, joints, urdf_text)
    notes = {joint.name: f"{names_text(joint.assumed)} assumed" for joint in joints if joint.assumed}
    texts = {} if request.package else {MODEL_FILE: model_text}
    texts |= {IMPORT_FILE: import_toml(source, model=_model_name(request), notes=notes), TOML_FILE: config.toml_text}
    return NewRobot(config, source, joints, reach, texts)


def _source(request: RobotRequest) -> RobotSource:
    """Return where the model is, and how it stands."""
    urdf = MODEL_FILE if request.package is None else package_file(request.package, request.urdf)
    return RobotSource(request.package, urdf, base=Pose((0.0, 0.0, request.height_m)), drop=request.drop)


def _found(request: RobotRequest, joints: Sequence[ModelJoint], urdf_text: str) -> tuple[RobotConfig, Reach]:
    """Return the robot with the comfort posture, the centres and the box that are found, and its reach."""

    def config(
        comfort: Floats, centres: Floats, box: Floats, ahead: str = AHEAD, orientations: Floats | None = None
    ) -> RobotConfig:
        """Return the robot with these."""
        text = robot_toml(
            name=request.name,
            model=_model_name(request),
            joints=[(joint.name, len(joint.hands)) for joint in joints],
            comfort=comfort,
            hands=request.hands,
            centres=centres,
            box=box,
            seed=request.seed,
            ahead=ahead,
            orientations=orientations,
        )
        return parse_robot(text, urdf_text, origin=f"robot '{request.name}'")

    middle = np.array([(joint.limits.lower + joint.limits.upper) / 2.0 for joint in joints])
    kinematics = Kinematics(config(middle, np.zeros((len(request.hands), 3)), _ANY_BOX))
    reach = sample_reach(kinematics, seed=request.seed)
    comfort = Comfort(kinematics, reach).find()
    centres = np.round(kinematics.hands(comfort), 2) + 0.0
    orientations = _orientations(kinematics.robot, comfort) if request.pose else None
    ahead = _ahead(Statics(kinematics.robot).origins(comfort), joints, centres, list(request.hands))
    box = BoxSearch(config(comfort, centres, _ANY_BOX, ahead, orientations)).largest(float(reach.radii.min()))
    return config(comfort, centres, box, ahead, orientations), reach


def _ahead(origins: Floats, joints: Sequence[ModelJoint], centres: Floats, hands: Sequence[str]) -> str:
    """Return the level axis of the world that is nearest to the way from the arms' first joints to the centres.

    Parameters
    ----------
    origins : array, shape (n, 3)
        Origins of the joints in the comfort posture [m].
    joints : sequence of ModelJoint, length n
        The joints, from the ground outwards.
    centres : array, shape (hands, 3)
        Centres of the hands' boxes [m].
    hands : sequence of str
        Names of the hands.
    """
    first = [next(place for place, joint in enumerate(joints) if hand in joint.hands) for hand in hands]
    x, y, _ = (centres - origins[first]).mean(axis=0)
    axis, along = ("y", y) if abs(y) > abs(x) else ("x", x)
    return axis if along >= 0.0 else f"-{axis}"


def _orientations(robot: RobotConfig, posture: Floats) -> Floats:
    """Return the orientations of the hands at a posture (n,), as quaternions x, y, z, w to six digits, (hands, 4)."""
    _, rotations = HandKinematics(robot).poses(posture)
    turned = quaternions_of_matrices(rotations)
    orientations: Floats = np.round(turned / np.linalg.norm(turned, axis=1, keepdims=True), 6) + 0.0
    return orientations


def _completed(source: RobotSource, joints: Sequence[ModelJoint], rigid: Mapping[str, float]) -> RobotSource:
    limits = tuple((joint.name, joint.given) for joint in joints if joint.given is not None)
    return replace(source, frozen=tuple(rigid.items()), limits=limits)


def _model_name(request: RobotRequest) -> str:
    return Path(request.urdf).name
