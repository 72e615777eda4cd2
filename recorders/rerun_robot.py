"""A robot in a Rerun recording: its links, moved by its joints alone, and each joint against its limits."""

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
from numpy.typing import NDArray
from rerun.urdf import UrdfJoint, UrdfTree

from recorders.errors import JointError, RobotError

Floats = NDArray[np.float64]

WORLD = "tf#/"  # the name that Rerun gives to the frame of a view whose origin is "/"
GAUGES = "limits"
ROW_HEIGHT = 14.0  # of a gauge, where the limits are at -100 and 100
LABEL_AT = -150.0

_GREY, _BLUE, _ORANGE = (110, 110, 110), (86, 180, 233), (230, 159, 0)
_NEAR_PERCENT = 90.0  # of the way from the middle of a joint's range to a limit


@dataclass(frozen=True, eq=False)
class RobotModel:
    """A robot as Rerun knows it, and the joints that are told of, in the order in which they are.

    Attributes
    ----------
    tree : UrdfTree
    joints : tuple of UrdfJoint, length n
    """

    tree: UrdfTree
    joints: tuple[UrdfJoint, ...]

    @classmethod
    def load(cls, urdf_text: str, joint_names: Sequence[str]) -> "RobotModel":
        """Read a URDF and find the joints by their names.

        Raises
        ------
        RobotError
            The URDF cannot be read.
        JointError
            A joint is not in it, or is named twice.
        """
        tree = _load_urdf(urdf_text)
        return cls(tree, _find_joints(tree, joint_names))

    def send_still(self, recording: rr.RecordingStream) -> None:
        """Send all that does not move: links, names and styles, the ranges of the joints."""
        self.tree.log_urdf_to_recording(recording)
        root = rr.Transform3D(parent_frame=WORLD, child_frame=self.tree.root_link().name)
        recording.log("robot/root", root, static=True)
        units = ["m" if joint.joint_type == "prismatic" else "rad" for joint in self.joints]
        names = [f"{joint.name} [{unit}]" for joint, unit in zip(self.joints, units, strict=True)]
        recording.log("joints", rr.SeriesLines(names=names), static=True)
        self._send_gauges(recording)

    def send(self, recording: rr.RecordingStream, index: Sequence[Any], joints: Floats) -> None:
        """Send postures [rad or m], shape (T, n), one for each row of the index.

        The numbers of all joints are one entity: an entity each costs sixteen times as much to write.
        """
        for joint, values in zip(self.joints, joints.T, strict=True):
            columns = joint.compute_transform_columns(values.tolist(), clamp=False)
            recording.send_columns(f"robot/moving/{joint.name}", index, columns)
        rows = [len(self.joints)] * len(joints)
        recording.send_columns("joints", index, rr.Scalars.columns(scalars=joints.ravel()).partition(rows))
        percent = self.percent_of_range(joints)  # (T, n)
        points = np.stack([percent, np.broadcast_to(self._rows, percent.shape)], axis=2)
        colours = np.where(np.abs(percent)[..., np.newaxis] < _NEAR_PERCENT, _BLUE, _ORANGE).astype(np.uint8)
        columns = rr.Points2D.columns(positions=points.reshape(-1, 2), colors=colours.reshape(-1, 3))
        recording.send_columns(f"{GAUGES}/now", index, columns.partition(rows))

    def percent_of_range(self, joints: Floats) -> Floats:
        """Return where postures (T, n) stand in the joints' ranges: -100 at the lower limit, 100 at the upper."""
        limits = np.array([_limits(joint) for joint in self.joints])  # (n, 2)
        middle, half = limits.mean(axis=1), (limits[:, 1] - limits[:, 0]) / 2.0
        return np.asarray((joints - middle) / half * 100.0)

    @property
    def _rows(self) -> Floats:
        return np.arange(len(self.joints)) * ROW_HEIGHT

    def _send_gauges(self, recording: rr.RecordingStream) -> None:
        ranges = [[(-100.0, y), (100.0, y)] for y in self._rows]
        bottom = self._rows[-1]
        middle_and_ends = [[(x, -ROW_HEIGHT / 2.0), (x, bottom + ROW_HEIGHT / 2.0)] for x in (-100.0, 0.0, 100.0)]
        lines = rr.LineStrips2D(ranges + middle_and_ends, colors=[_GREY], radii=[0.4])
        recording.log(f"{GAUGES}/range", lines, static=True)
        places = np.column_stack([np.full(len(self.joints), LABEL_AT), self._rows])
        names = [joint.name for joint in self.joints]
        labels = rr.Points2D(places, labels=names, show_labels=True, radii=[0.01], colors=[_GREY])
        recording.log(f"{GAUGES}/names", labels, static=True)
        recording.log(f"{GAUGES}/now", rr.Points2D.from_fields(radii=[4.0]), static=True)


def _limits(joint: UrdfJoint) -> tuple[float, float]:
    lower, upper = joint.limit_lower, joint.limit_upper
    return (lower, upper) if np.isfinite([lower, upper]).all() and lower < upper else (-np.pi, np.pi)


def _load_urdf(urdf_text: str) -> UrdfTree:
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
        raise JointError(f"expected joints of the robot, found '{missing[0]}'; it has {', '.join(sorted(movable))}")
    if len(set(names)) != len(names):
        raise JointError(f"expected each joint once, found {', '.join(names)}")
    return tuple(movable[name] for name in names)
