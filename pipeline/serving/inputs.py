"""Reads and checks the messages of a tick: hand targets, and the joints that were measured."""

import math

from pipeline.robot.range_check import RangeCheck, is_within
from pipeline.serving.rejections import Rejection, undecodable, unusable, wrong_type
from recorders.cdr.codec import decode_as
from recorders.cdr.templates import Position
from recorders.errors import JointError, MessageError, OutOfRange
from recorders.messages.message_types import JointState, PoseStamped
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import type_of
from recorders.ticks.joiner import PoseReader
from recorders.ticks.stamp_joiner import RejectionError


class TargetReader:
    """Reads the targets of one hand, or what was measured of it.

    Parameters
    ----------
    centre : tuple of float
        Middle of the hand's pattern [m].
    check : RangeCheck
        What else is asked of a target.
    outside_m : float
        Targets farther than this from the centre along an axis are counted [m].
    pose : callable, optional
        Reads the pose of a hand whose pose is controlled; of others the orientation is not looked at.

    Attributes
    ----------
    outside : int
        Targets counted so far.
    """

    def __init__(
        self, centre: Position, check: RangeCheck, outside_m: float, *, pose: PoseReader | None = None
    ) -> None:
        self._centre, self._check, self._outside_m, self._pose = centre, check, outside_m, pose
        self.outside = 0

    def read(self, record: RecordedMessage) -> tuple[int, tuple[float, ...]]:
        """Return stamp [ns] and position [m], and the turn [rad] of a hand whose pose is controlled.

        Raises
        ------
        RejectionError
            If the message is no target.
        """
        if record.type != PoseStamped.TYPE:
            raise wrong_type(record, PoseStamped.TYPE)
        try:
            pose = decode_as(PoseStamped, record.data)
            position = tuple(pose.position.tolist())
            self._check.check_target(position)
            numbers = position if self._pose is None else tuple(self._pose(pose).tolist())
        except OutOfRange as error:
            raise unusable(record, error) from None
        except MessageError as error:
            raise undecodable(record, error) from None
        self.outside += not is_within(position, self._centre, self._outside_m)
        return pose.stamp_ns, numbers


class JointsReader:
    """Reads the joints that were measured.

    Parameters
    ----------
    check : RangeCheck
        What is asked of them.
    """

    def __init__(self, check: RangeCheck) -> None:
        self._check = check

    def read(self, record: RecordedMessage) -> tuple[int, JointState]:
        """Return stamp [ns] and joints.

        Raises
        ------
        RejectionError
            If the message holds no joints of the robot.
        """
        if record.type != JointState.TYPE:
            raise wrong_type(record, JointState.TYPE)
        try:
            joints = decode_as(JointState, record.data)
            self._check.check_joints(joints)
        except JointError as error:
            raise RejectionError(Rejection.WRONG_JOINTS, f"{record.topic}: {error}") from None
        except OutOfRange as error:
            raise unusable(record, error) from None
        except MessageError as error:
            raise undecodable(record, error) from None
        return joints.stamp_ns, joints


def reader_of(topic: str, check: RangeCheck) -> TargetReader | JointsReader:
    """Return a reader of a topic that is learned from: joints, or a position anywhere."""
    if type_of(topic) == JointState.TYPE:
        return JointsReader(check)
    return TargetReader((0.0, 0.0, 0.0), check, math.inf, pose=check.poses.get(topic))
