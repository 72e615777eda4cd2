"""From ticks to samples: what a step of the network is given and taught."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.robot import RobotConfig, parse_robot
from recorders.errors import LogError
from recorders.reader import LogReader
from recorders.ticks import JointMap, Tick, join_ticks
from replay.engine import naming, read_robot

Floats = NDArray[np.float64]

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


def read_samples(path: Path) -> Samples:
    """Read the samples of a log.

    Raises
    ------
    LogError
        If the log cannot be read or holds fewer than two ticks.
    MessageError, JointError, RobotError
        If its messages or its robot are not what they should be.
    """
    reader = LogReader(path)
    texts = read_robot(reader)
    if not texts:
        raise LogError(
            f"{path}: expected the robot's files among the attachments, found {reader.attachments or 'none'}"
        )
    robot = parse_robot(texts["toml"], texts["urdf"])
    pairs = CommandedPairs(robot.joints)
    u, d = np.empty(HANDS), np.empty(HANDS + len(robot.joints))
    with naming(path):
        rows = [(u.copy(), d[HANDS:].copy()) for tick in join_ticks(reader) if pairs.fill(tick, u, d)]
    if not rows:
        raise LogError(f"{path}: expected at least two complete ticks, found fewer; record with explore")
    return Samples(np.array([row[0] for row in rows]), np.array([row[1] for row in rows]), robot)
