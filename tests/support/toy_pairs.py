"""A pairing rule as somebody else writes it: the target of a tick, and the joints measured at its instant."""

import numpy as np

from pipeline.arrays import Floats
from pipeline.robot.config import RobotConfig
from pipeline.samples.pairing import PairingRule
from recorders.messages.topics import commanded_tick
from recorders.ticks.joiner import JointMap, Tick


class ToyPairs:
    def __init__(self, robot: RobotConfig) -> None:
        self._joints = JointMap(robot.joints)
        self.pending: Floats = np.empty(0)
        self.stamp_ns = 0

    def resume(self, pending: Floats) -> None:
        pass

    def begin(self) -> None:
        pass

    def fill(self, tick: Tick, u: Floats, d: Floats) -> bool:
        joints = self._joints.positions(tick.joints)
        u[:] = np.concatenate(tick.hands)
        d[:] = np.concatenate([*tick.hands, joints])
        self.stamp_ns = tick.stamp_ns
        return True


RULE = PairingRule("toy", commanded_tick, ToyPairs)
