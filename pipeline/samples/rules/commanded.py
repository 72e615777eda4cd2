"""Targets as commanded, and the joints at the end of their hold: the paper's pairs."""

import numpy as np

from pipeline.arrays import Floats
from pipeline.robot.config import RobotConfig
from pipeline.samples.pairing import COMMANDED, PairingRule
from recorders.messages.topics import commanded_tick
from recorders.ticks.joiner import JointMap, Tick


class CommandedPairs:
    """Pairs each tick with the one before it: u(k) is held until t_{k+1}, so d(k) = (u(k+1); q(k)) is complete then.

    This is the paper's choice of training pairs, (target commanded, joints measured): the teacher's lag stays in the
    data. The first tick of a cycle only sets u.

    Parameters
    ----------
    robot : RobotConfig
        Whose joints and hands they are.
    """

    def __init__(self, robot: RobotConfig) -> None:
        self._joints = JointMap(robot.joints)
        self._held: tuple[Floats, ...] = ()  # u(k), in parts; none before the first tick of a cycle
        self._held_since_ns = 0
        self.stamp_ns = 0

    @property
    def pending(self) -> Floats:
        """u(k) that waits for its teaching signal [m], shape (3 hands,), or (0,) before the first tick of a cycle."""
        held = self._held
        return np.concatenate(held) if held else np.empty(0)

    def resume(self, pending: Floats) -> None:
        """Go on from what was pending, shape (3 hands,) or (0,)."""
        self._held = (pending.copy(),) if len(pending) else ()

    def begin(self) -> None:
        """Start a cycle: nothing is pending."""
        self._held = ()

    def fill(self, tick: Tick, u: Floats, d: Floats) -> bool:
        """Complete the step that the tick before has begun; False for the first tick of a cycle."""
        held, joints = self._held, self._joints.positions(tick.joints)
        if held:
            np.concatenate(held, out=u)
            np.concatenate((*tick.hands, joints), out=d)
        self._held = tick.hands
        self.stamp_ns, self._held_since_ns = self._held_since_ns, tick.stamp_ns
        return bool(held)


RULE = PairingRule(COMMANDED, commanded_tick, CommandedPairs)
