"""Hands and joints as measured at one instant: what a posture reaches, whatever was asked for."""

import numpy as np

from pipeline.arrays import Floats
from pipeline.robot.config import RobotConfig
from pipeline.samples.pairing import PairingRule
from recorders.messages.topics import reached_tick
from recorders.ticks.joiner import JointMap, Tick


class ReachedPairs:
    """Makes a step of every tick: x(k) and q(k) are measured at one instant, so d(k) = (x(k); q(k)) is complete then.

    No lag of a teacher or a servo is in these pairs, as no target is. Nothing waits for a later tick.

    Parameters
    ----------
    robot : RobotConfig
        Whose joints and hands they are.
    """

    def __init__(self, robot: RobotConfig) -> None:
        self._joints, self._size = JointMap(robot.joints), robot.input_centre.size
        self.stamp_ns = 0

    @property
    def pending(self) -> Floats:
        """Nothing, shape (0,)."""
        return np.empty(0)

    def resume(self, pending: Floats) -> None:
        """Go on: nothing is ever pending."""

    def begin(self) -> None:
        """Start a cycle: nothing is pending."""

    def fill(self, tick: Tick, u: Floats, d: Floats) -> bool:
        """Complete the step of this tick."""
        joints = self._joints.positions(tick.joints)
        self.fill_hands(tick, joints, u)
        d[: self._size] = u
        d[self._size :] = joints
        self.stamp_ns = tick.stamp_ns
        return True

    def fill_hands(self, tick: Tick, joints: Floats, u: Floats) -> None:
        """Write the hands at the instant of a posture (n,) into the inputs `u` (inputs,)."""
        np.concatenate(tick.hands, out=u)


RULE = PairingRule("reached", reached_tick, ReachedPairs, otherwise="computed")
