"""Frames that poses are given in: the robot's own, and those that stand still in it by `/tf_static`."""

from collections.abc import Collection

import numpy as np

from pipeline.alignment.config import Transform
from pipeline.arrays import Floats
from pipeline.rotations import product, rotated, unit
from recorders.cdr.codec import decode_as
from recorders.errors import MessageError
from recorders.messages.message_types import TFMessage
from recorders.messages.record import RecordedMessage

_HERE: Transform = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
_MAX_FRAMES = 10_000
_POSITION = 3


def placed(transform: Transform, poses: Floats) -> Floats:
    """Return poses of a frame, shape (n, 7), in the frame in which it has this pose; those of `_HERE` to the bit."""
    if transform == _HERE or not len(poses):
        return poses
    pose = np.array([transform])
    turn = np.repeat(unit(pose[:, _POSITION:]), len(poses), axis=0)
    positions = rotated(turn, poses[:, :_POSITION]) + pose[:, :_POSITION]
    return np.concatenate((positions, unit(product(turn, poses[:, _POSITION:]))), axis=1)


def mounted(poses: Floats, offset: Transform) -> Floats:
    """Return what stands so in the frame of each of some poses, shape (n, 7), as poses in the frame that those are in.

    Parameters
    ----------
    poses : ndarray, shape (n, 7)
        Poses of a marker, of which the quaternions have length 1.
    offset : Transform
        Pose in its frame.
    """
    if not len(poses):
        return poses
    pose = np.repeat(np.array([offset]), len(poses), axis=0)
    turns = poses[:, _POSITION:]
    positions = rotated(turns, pose[:, :_POSITION]) + poses[:, :_POSITION]
    return np.concatenate((positions, unit(product(turns, unit(pose[:, _POSITION:])))), axis=1)


class StaticFrames:
    """Frames by name, each in the robot's world.

    A frame is the robot's own, or stands still in it by what has come on `/tf_static` so far: no other is guessed.

    Parameters
    ----------
    own : collection of str
        Names of the robot's world: its root link, and what stands for it.
    """

    def __init__(self, own: Collection[str]) -> None:
        self._own = frozenset(own)
        self._parents: dict[str, tuple[str, Transform]] = {}
        self._found: dict[str, Transform | None] = {}

    def learn(self, record: RecordedMessage) -> None:
        """Take in a message on `/tf_static`; one that cannot be read is passed over."""
        try:
            message = decode_as(TFMessage, record.data)
        except MessageError:
            return
        self._found.clear()
        for transform in message.transforms:
            numbers = (*transform.translation.tolist(), *transform.rotation.tolist())
            if len(self._parents) < _MAX_FRAMES and np.isfinite(numbers).all() and any(numbers[_POSITION:]):
                self._parents[_plain(transform.child_frame_id)] = _plain(transform.frame_id), numbers

    def find(self, frame_id: str) -> Transform | None:
        """Return the pose of a frame in the robot's world, None if it has none that is known."""
        frame = _plain(frame_id)
        if frame not in self._found:
            if len(self._found) >= _MAX_FRAMES:
                self._found.clear()
            self._found[frame] = self._climb(frame) or self._descend(frame)
        return self._found[frame]

    def _climb(self, frame: str) -> Transform | None:
        """Return the pose of a frame that the robot's world is an ancestor of."""
        pose, passed = np.array([_HERE]), set[str]()
        while frame not in self._own:
            if frame not in self._parents or frame in passed:
                return None
            passed.add(frame)
            frame, transform = self._parents[frame]
            pose = placed(transform, pose)
        return _transform(pose)

    def _descend(self, frame: str) -> Transform | None:
        """Return the pose of a frame that is an ancestor of the robot's world, such as a map that it stands in."""
        for own in sorted(self._own & self._parents.keys()):
            pose, at, passed = np.array([_HERE]), own, set[str]()
            while at in self._parents and at not in passed:
                passed.add(at)
                at, transform = self._parents[at]
                pose = placed(transform, pose)
                if at == frame:
                    return _transform(_inverse(pose))
        return None


def _inverse(pose: Floats) -> Floats:
    back = pose[:, _POSITION:] * np.array([-1.0, -1.0, -1.0, 1.0])
    return np.concatenate((-rotated(back, pose[:, :_POSITION]), back), axis=1)


def _transform(pose: Floats) -> Transform:
    x, y, z, qx, qy, qz, qw = pose[0].tolist()
    return x, y, z, qx, qy, qz, qw


def _plain(frame_id: str) -> str:
    return frame_id.removeprefix("/")
