"""Reads and checks the messages of a tick: hand targets, and the joints that were measured."""

import math

from pipeline.robot.range_check import OutOfRange, RangeCheck, is_within
from pipeline.serving.rejections import Rejection, undecodable, unusable, wrong_type
from recorders.cdr.codec import decode_as
from recorders.cdr.templates import Position
from recorders.errors import JointError, MessageError
from recorders.messages.message_types import JointState, PoseStamped
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import type_of
from recorders.ticks.stamp_joiner import RejectionError


class TargetReader:
    """Reads the targets of one hand.

    Parameters
    ----------
    centre : tuple of float
        Middle of the hand's pattern [m].
    check : RangeCheck
        What else is asked of a target.
    outside_m : float
        Targets farther than this from the centre along an axis are counted [m].

    Attributes
    ----------
    outside : int
        Targets counted so far.
    """

    def __init__(self, centre: Position, check: RangeCheck, outside_m: float) -> None:
        self._centre, self._check, self._outside_m = centre, check, outside_m
        self.outside = 0

    def read(self, record: RecordedMessage) -> tuple[int, Position]:
        """Return stamp [ns] and position [m].

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
        except OutOfRange as error:
            raise unusable(record, error) from None
        except MessageError as error:
            raise undecodable(record, error) from None
        self.outside += not is_within(position, self._centre, self._outside_m)
        return pose.stamp_ns, position


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
    return JointsReader(check) if type_of(topic) == JointState.TYPE else TargetReader((0.0, 0.0, 0.0), check, math.inf)
