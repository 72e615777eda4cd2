"""Rows that a viewer draws of the messages of a session: posture, targets in force, hands reached."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from pipeline.arrays import Floats
from pipeline.robot.config import RobotConfig
from pipeline.robot.coordinates import POSITION_SIZE, row_size, to_rows
from pipeline.robot.kinematics import Kinematics
from pipeline.views.orientations import orientations_of_rows
from recorders.errors import MotionError
from recorders.messages.message_types import Float64MultiArray, JointState, Message, PoseStamped
from recorders.messages.topics import (
    JOINT_COMMANDS,
    JOINT_STATES,
    LEARNER_ERROR,
    SAMPLE_JOINTS,
    hand_target,
)
from recorders.rerun_scene.track import MAX_TIME_NS, Track
from recorders.ticks.joiner import JointMap

JOINT_TOPICS = (JOINT_STATES, SAMPLE_JOINTS, JOINT_COMMANDS)
"""Topics that postures are taken from: the first of these that there is."""

MAX_ROWS = 20_000
"""Rows that a viewer is given at once: over six minutes at 50 Hz; of more, some are left out evenly."""

_NS_PER_S = 10**9
_CM_PER_M = 100.0


class _Target:
    """The target of a hand by row, and the one before it."""

    def __init__(self, size: int) -> None:
        self._size = size
        self._stamp_ns = -1
        self._before: Floats | None = None
        self._latest: Floats | None = None

    def take(self, pose: PoseStamped) -> None:
        """Take a new target."""
        row = np.concatenate([pose.position, pose.orientation])[: self._size]
        self._before, self._latest, self._stamp_ns = self._latest, row, pose.stamp_ns

    def aimed_at(self, stamp_ns: int, *, commanded: bool) -> Floats | None:
        """Return what a command of this stamp answers, or what a posture measured then was to reach: u(k-1) at t_k."""
        if commanded or stamp_ns > self._stamp_ns or self._before is None:
            return self._latest
        return self._before

    def changes_at(self, stamp_ns: int) -> bool:
        """Return whether the target before was held until this instant."""
        return self._before is not None and stamp_ns == self._stamp_ns


class MotionRows:
    """Collects rows, one for each posture on one topic.

    Scored are, as in the paper, the ends of holds, and all commands.

    Parameters
    ----------
    robot : RobotConfig
        Whose joints they are, and how they move the hands.
    joints_topic : str
        The topic that postures are taken from.
    asked : callable, optional
        Returns the topic, by the name of a hand, of what its posture is compared with: of its target unless given. None
        compares with nothing: targets are then where the posture has the hands.

    Attributes
    ----------
    topics : frozenset of str
        The topics that make rows.
    errors : list of (int, ndarray)
        Times [ns], and the errors of the hands [cm], shape (hands,), that a learner published then.
    """

    def __init__(
        self, robot: RobotConfig, *, joints_topic: str, asked: Callable[[str], str] | None = hand_target
    ) -> None:
        self._kinematics = Kinematics(robot)
        self._joints = JointMap(robot.joints)
        self._topic = joints_topic
        self._at_once = joints_topic == JOINT_COMMANDS or asked is not hand_target  # what is held comes before
        self._robot = robot
        self._hands = {asked(name): _Target(row_size(robot)) for name in robot.hand_names} if asked else {}
        self.topics = frozenset({*self._hands, LEARNER_ERROR, *JOINT_TOPICS})
        self._start_ns: int | None = None
        self._rows: list[tuple[int, Floats, Floats, bool]] = []  # time [ns], posture (n,), targets by row, scored
        self.errors: list[tuple[int, Floats]] = []

    def __len__(self) -> int:
        """Rows that wait to be taken."""
        return len(self._rows)

    def feed(self, topic: str, message: Message, time_ns: int) -> None:
        """Take one message; `time_ns` is where it goes on the time line, which begins with the first.

        Raises
        ------
        JointError
            If a posture lacks a joint of the robot.
        MotionError
            If the time is further from the first than a time line reaches, or a joint of the robot is not finite.
        """
        if self._start_ns is None:
            self._start_ns = time_ns
        since_ns = time_ns - self._start_ns
        if abs(since_ns) > MAX_TIME_NS:
            raise MotionError(
                f"{topic}: expected messages within {MAX_TIME_NS // _NS_PER_S} s of the first, which a time line "
                f"holds, found one {since_ns // _NS_PER_S} s from it; its log time is wrong"
            )
        hand, hands = self._hands.get(topic), (len(self._robot.hands),)
        if hand is not None and isinstance(message, PoseStamped):
            hand.take(message)
        elif topic == LEARNER_ERROR and isinstance(message, Float64MultiArray) and message.data.shape == hands:
            self.errors.append((since_ns, message.data * _CM_PER_M))
        elif topic == self._topic and isinstance(message, JointState):
            self._add(message, since_ns)

    def take(self) -> Track | None:
        """Return the rows since the last time, evenly thinned out to `MAX_ROWS`; None if there are none.

        Raises
        ------
        MotionError
            If a number in them is not finite.
        """
        if not self._rows:
            return None
        rows, self._rows = self._rows[:: -(-len(self._rows) // MAX_ROWS)], []
        times_ns, postures, targets, scored = (np.array(column) for column in zip(*rows, strict=True))
        track = Track.checked(
            joint_count=postures.shape[1],
            hand_count=len(self._robot.hands),
            times_ns=times_ns,
            joints=postures,
            targets=targets[..., :POSITION_SIZE],
            reached=self._kinematics.hands_along(postures),
            orientations=orientations_of_rows(self._kinematics, targets, postures),
        )
        return replace(track, scored=scored)

    def _add(self, joints: JointState, since_ns: int) -> None:
        hands = self._hands.values()
        aims = [aim for hand in hands if (aim := hand.aimed_at(joints.stamp_ns, commanded=self._at_once)) is not None]
        if len(aims) == len(hands):  # before the first targets there is nothing to compare with
            scored = self._at_once or any(hand.changes_at(joints.stamp_ns) for hand in hands)
            posture = self._joints.positions(joints)
            if not np.isfinite(posture).all():
                index = int(np.flatnonzero(~np.isfinite(posture))[0])
                raise MotionError(
                    f"{self._topic}: expected a finite position for joint {self._joints.names[index]}, "
                    f"found {posture[index]}"
                )
            rows = np.stack(aims) if aims else to_rows(self._robot, self._kinematics.inputs(posture))
            self._rows.append((since_ns, posture, rows, scored))
