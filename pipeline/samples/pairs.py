"""From ticks to samples: what a step of the network is given and taught."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from pipeline.arrays import Floats
from pipeline.robot.config import RobotConfig
from pipeline.robot.range_check import range_check
from pipeline.robot.recorded import recorded_robot, require_recorded_robot
from recorders.errors import LogError
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import SESSION_PHASE
from recorders.reading.parts import Log
from recorders.reading.session_reader import Reader, open_log
from recorders.ticks.joiner import RANKS, JointMap, Tick, join_ticks
from replay.sources.scheduled import naming, renamed
from replay.sources.stream_digest import digest_link

HANDS = 6
"""Inputs of the network: two hand positions."""


class CommandedPairs:
    """Pairs each tick with the one before it: u(k) is held until t_{k+1}, so d(k) = (u(k+1); q(k)) is complete then.

    This is the paper's choice of training pairs, (target commanded, joints measured): the teacher's lag stays in the
    data. The first tick of a cycle only sets u.

    Parameters
    ----------
    joints : tuple of str
        The joints in the order of the outputs.
    """

    def __init__(self, joints: tuple[str, ...]) -> None:
        self._joints = JointMap(joints)
        self._held: Floats = np.empty(HANDS)
        self._waiting = False

    @property
    def pending(self) -> Floats:
        """u(k) that waits for its teaching signal [m], shape (6,), or (0,) before the first tick of a cycle."""
        return self._held.copy() if self._waiting else np.empty(0)

    def resume(self, pending: Floats) -> None:
        """Go on from what was pending, shape (6,) or (0,)."""
        self._waiting = len(pending) > 0
        if self._waiting:
            self._held[:] = pending

    def begin(self) -> None:
        """Start a cycle: nothing is pending."""
        self._waiting = False

    def fill(self, tick: Tick, u: Floats, d: Floats) -> bool:
        """Complete a step with a tick.

        Parameters
        ----------
        tick : Tick
            The next tick of the cycle.
        u : ndarray, shape (6,)
            Takes the input of the step that is complete now [m].
        d : ndarray, shape (6 + n,)
            Takes its teaching signal: next targets [m], joints [rad or m].

        Returns
        -------
        bool
            False for the first tick of a cycle: no step is complete.

        Raises
        ------
        JointError
            If the tick lacks a joint.
        """
        complete = self._waiting
        joints = self._joints.positions(tick.joints)
        if complete:
            u[:] = self._held
        self._held[:3] = tick.left
        self._held[3:] = tick.right
        d[:HANDS] = self._held
        d[HANDS:] = joints
        self._waiting = True
        return complete


@dataclass(frozen=True, eq=False)
class Presentation:
    """Samples of one presentation, joined once and used for every repetition.

    T steps take T + 1 ticks.

    Attributes
    ----------
    stamps_ns : list of int, length T + 1
        Stamps of the ticks [ns].
    u : ndarray, shape (T, 6)
        Hand targets [m].
    d : ndarray, shape (T, 6 + joints)
        What they teach: next targets [m], joints [rad or m].
    pending : ndarray, shape (6,)
        The target of the last tick [m], which waits for a teaching signal.
    links : list of bytes, length T + 1
        What each tick adds to the stream digest.
    """

    stamps_ns: list[int]
    u: Floats
    d: Floats
    pending: Floats
    links: list[bytes]

    @classmethod
    def of(cls, messages: Iterable[RecordedMessage], robot: RobotConfig) -> "Presentation":
        """Join the messages of one presentation to ticks, and these to steps, as `LearningRun.feed` does.

        Raises
        ------
        MessageError, JointError
            If a message is not what it should be, or cannot be of the robot.
        """
        ticks = list(join_ticks(messages, range_check(robot)))
        pairs = CommandedPairs(robot.joints)
        u, d = np.empty((len(ticks), HANDS)), np.empty((len(ticks), HANDS + len(robot.joints)))
        for row, tick in enumerate(ticks):
            pairs.fill(tick, u[row], d[row])
        return cls(
            stamps_ns=[tick.stamp_ns for tick in ticks],
            u=u[1:],  # the first tick completes no step
            d=d[1:],
            pending=pairs.pending,
            links=[digest_link(tick.records) for tick in ticks],
        )


@dataclass(frozen=True, eq=False)
class Samples:
    """The samples of one episode.

    Attributes
    ----------
    targets : ndarray, shape (T, 6)
        u(k): hand positions asked for [m], left then right.
    joints : ndarray, shape (T, n)
        q(k): joints at the end of the hold of u(k) [rad or m].
    robot : RobotConfig
        The robot that was recorded.
    """

    targets: Floats
    joints: Floats
    robot: RobotConfig


def read_samples(path: Log, *, robot: RobotConfig | None = None) -> Samples:
    """Read the samples of a log; of a recorded session, those of its first presentation.

    Parameters
    ----------
    path : Path or Parts
        A log, or a session in parts.
    robot : RobotConfig, optional
        The robot, for a log that carries none.

    Raises
    ------
    LogError
        If the log cannot be read, holds fewer than two ticks, or carries no robot and none is given.
    MessageError, JointError, RobotError
        If its messages or its robot are not what they should be.
    """
    reader = open_log(path)
    robot = recorded_robot(reader) or robot or require_recorded_robot(reader)
    with naming(path):
        presented = Presentation.of(_first_presentation(reader), robot)
    if not len(presented.u):
        raise LogError(f"{path}: expected at least two complete ticks, found fewer; record with explore")
    return Samples(presented.u, presented.d[:, HANDS:].copy(), robot)


def _first_presentation(reader: Reader) -> Iterator[RecordedMessage]:
    """Yield the learner's messages of an episode, and of a session those between its first two phase markers."""
    under_way = not reader.counts.get(SESSION_PHASE)
    for message in renamed(reader, {}, (SESSION_PHASE, *RANKS)):
        if message.topic == SESSION_PHASE:
            if under_way:
                return
            under_way = True
        elif under_way:
            yield message
