"""A robot in a Rerun recording: its links, moved by its joints alone, and each joint against its limits."""

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rerun as rr
from numpy.typing import ArrayLike
from rerun.urdf import UrdfJoint, UrdfTree

from recorders.errors import JointError, RobotError
from recorders.messages.validation import FloatArray
from recorders.rerun_scene.track import Instants
from recorders.text.wording import names_text

WORLD = "tf#/"  # the name that Rerun gives to the frame of a view whose origin is "/"
GAUGES = "limits"
ROW_HEIGHT = 14.0  # of a gauge, where the limits are at -100 and 100
LABEL_AT = -150.0

_LABEL_HANGS = 0.7 * ROW_HEIGHT  # Rerun writes below a point
_LIGHT, _GREY, _BLUE, _ORANGE = (210, 210, 210), (110, 110, 110), (86, 180, 233), (230, 159, 0)
_NEAR_PERCENT = 90.0  # of the way from the middle of a joint's range to a limit


@dataclass(frozen=True, eq=False)
class RobotModel:
    """A robot as Rerun knows it, and the joints that are logged, in order.

    Attributes
    ----------
    tree : UrdfTree
    joints : tuple of UrdfJoint, length n
    """

    tree: UrdfTree
    joints: tuple[UrdfJoint, ...]

    @classmethod
    def load(cls, urdf_text: str, joint_names: Sequence[str]) -> "RobotModel":
        """Read a URDF, in which no mesh and no texture names a file, and find the joints by their names.

        Raises
        ------
        RobotError
            The URDF cannot be read, or names a file.
        JointError
            A joint is not in it, or is named twice.
        """
        tree = _load_urdf(urdf_text)
        return cls(tree, _find_joints(tree, joint_names))

    def send_static(self, recording: rr.RecordingStream) -> None:
        """Send all that does not move: links, names and styles, the ranges of the joints."""
        self.tree.log_urdf_to_recording(recording)
        root = rr.Transform3D(parent_frame=WORLD, child_frame=self.tree.root_link().name)
        recording.log("robot/root", root, static=True)
        units = ["m" if joint.joint_type == "prismatic" else "rad" for joint in self.joints]
        names = [f"{joint.name} [{unit}]" for joint, unit in zip(self.joints, units, strict=True)]
        recording.log("joints", rr.SeriesLines(names=names), static=True)
        self._send_gauges(recording)

    def send(self, recording: rr.RecordingStream, instants: Instants, joints: FloatArray) -> None:
        """Send postures [rad or m], shape (T, n).

        All joints are one entity: an entity each costs sixteen times as much to write. A pose has a row of its own.
        """
        index = instants.columns()
        rows = [len(self.joints)] * len(joints)
        translations, quaternions = joint_poses(self.joints, joints)
        poses = rr.Transform3D.columns(
            translation=translations.reshape(-1, 3),
            quaternion=quaternions.reshape(-1, 4),
            parent_frame=[joint.parent_link for joint in self.joints] * len(joints),
            child_frame=[joint.child_link for joint in self.joints] * len(joints),
        )
        recording.send_columns("robot/moving", instants.columns(each=len(self.joints)), poses)
        recording.send_columns("joints", index, rr.Scalars.columns(scalars=joints.ravel()).partition(rows))
        percent = self.percent_of_range(joints)  # (T, n)
        points = np.stack([percent, np.broadcast_to(self._rows, percent.shape)], axis=2)
        colours = np.where(np.abs(percent)[..., np.newaxis] < _NEAR_PERCENT, _BLUE, _ORANGE).astype(np.uint8)
        columns = rr.Points2D.columns(positions=points.reshape(-1, 2), colors=colours.reshape(-1, 3))
        recording.send_columns(f"{GAUGES}/now", index, columns.partition(rows))

    def percent_of_range(self, joints: FloatArray) -> FloatArray:
        """Return where postures (T, n) stand in the joints' ranges: -100 at the lower limit, 100 at the upper."""
        limits = np.array([_limits(joint) for joint in self.joints], dtype=np.float64)  # (n, 2)
        lower, upper = limits.T
        percent: FloatArray = (joints - (lower + upper) / 2.0) / (upper - lower) * 200.0
        return percent

    @property
    def _rows(self) -> FloatArray:
        return np.arange(len(self.joints), dtype=np.float64) * ROW_HEIGHT

    def _send_gauges(self, recording: rr.RecordingStream) -> None:
        ranges = [[(-100.0, y), (100.0, y)] for y in self._rows]
        bottom = self._rows[-1]
        middle_and_ends = [[(x, -ROW_HEIGHT / 2.0), (x, bottom + ROW_HEIGHT / 2.0)] for x in (-100.0, 0.0, 100.0)]
        lines = rr.LineStrips2D(ranges + middle_and_ends, colors=[_GREY], radii=[0.4])
        recording.log(f"{GAUGES}/range", lines, static=True)
        places = np.column_stack([np.full(len(self.joints), LABEL_AT), self._rows - _LABEL_HANGS])
        names = [joint.name for joint in self.joints]
        labels = rr.Points2D(places, labels=names, show_labels=True, radii=[0.01], colors=[_LIGHT])
        recording.log(f"{GAUGES}/names", labels, static=True)
        recording.log(f"{GAUGES}/now", rr.Points2D.from_fields(radii=[4.0]), static=True)


def joint_poses(joints: Sequence[UrdfJoint], values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the poses of the joints' child links in their parent links.

    Rerun's own function does one joint at a time, at a hundred times the cost.

    Parameters
    ----------
    joints : sequence of UrdfJoint, length n
    values : ndarray, shape (T, n)
        Postures [rad or m].

    Returns
    -------
    (ndarray, ndarray)
        Translations [m], shape (T, n, 3), and quaternions x, y, z, w, shape (T, n, 4).
    """
    roll, pitch, yaw = np.array([joint.origin_rpy for joint in joints]).T  # each (n,)
    origins = _product(_product(_about([0, 0, 1], yaw), _about([0, 1, 0], pitch)), _about([1, 0, 0], roll))
    axes = np.array([joint.axis for joint in joints])
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    slides = np.array([joint.joint_type == "prismatic" for joint in joints])
    along = np.where(slides, values, 0.0)[..., np.newaxis] * axes  # (T, n, 3)
    translations = np.array([joint.origin_xyz for joint in joints]) + _turned(origins, along)
    return translations, _product(origins, _about(axes, np.where(slides, 0.0, values)))


def _about(axis: ArrayLike, angle: FloatArray) -> FloatArray:
    """Return the quaternions x, y, z, w of turns by angles [rad] (...) about unit vectors, shape (..., 4)."""
    sine, cosine = np.sin(angle / 2.0)[..., np.newaxis], np.cos(angle / 2.0)[..., np.newaxis]
    return np.concatenate([np.asarray(axis) * sine, cosine], axis=-1)


def _product(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the quaternions of the turns b followed by a, shape (..., 4)."""
    (p, s), (q, t) = (a[..., :3], a[..., 3:]), (b[..., :3], b[..., 3:])
    vector = s * q + t * p + np.cross(p, q)
    return np.concatenate([vector, s * t - np.sum(p * q, axis=-1, keepdims=True)], axis=-1)


def _turned(quaternions: FloatArray, vectors: FloatArray) -> FloatArray:
    """Return vectors (..., 3) turned by quaternions (..., 4)."""
    axis, w = quaternions[..., :3], quaternions[..., 3:]
    sideways = np.cross(axis, vectors)
    turned: FloatArray = vectors + 2.0 * (w * sideways + np.cross(axis, sideways))
    return turned


def _limits(joint: UrdfJoint) -> tuple[float, float]:
    lower, upper = joint.limit_lower, joint.limit_upper
    return (lower, upper) if np.isfinite([lower, upper]).all() and lower < upper else (-np.pi, np.pi)


def _load_urdf(urdf_text: str) -> UrdfTree:
    if found := [tag for tag in ("<mesh", "<texture") if tag in urdf_text]:  # Rerun would open any file of any name
        raise RobotError(f"the URDF cannot be shown: expected shapes that need no file, found {found[0]}>")
    with tempfile.TemporaryDirectory() as directory:  # Rerun reads a URDF from files only
        path = Path(directory) / "robot.urdf"
        path.write_text(urdf_text, encoding="utf-8")
        try:
            return UrdfTree.from_file_path(path, entity_path_prefix="robot", static_transform_entity_path="robot/links")
        except RuntimeError as error:
            reason = " ".join(str(error).replace(str(path), "it").split())
            raise RobotError(f"the URDF cannot be read: {reason}") from error


def _find_joints(tree: UrdfTree, names: Sequence[str]) -> tuple[UrdfJoint, ...]:
    movable = {joint.name: joint for joint in tree.joints() if joint.joint_type != "fixed"}
    missing = [name for name in names if name not in movable]
    if missing:
        raise JointError(f"expected joints of the robot, found '{missing[0]}'; it has {names_text(sorted(movable))}")
    if len(set(names)) != len(names):
        raise JointError(f"expected each joint once, found {names_text(names)}")
    return tuple(movable[name] for name in names)
