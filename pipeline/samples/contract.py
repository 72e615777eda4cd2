"""Tests that every pairing rule passes; needs pytest, and a test class of one's own with a `rule`."""

from dataclasses import replace
from typing import ClassVar

import numpy as np
import pytest

from pipeline.arrays import Floats
from pipeline.robot.config import RobotConfig, load_robot
from pipeline.samples.pairing import PAIRING_RULES, PairingRule, find_pairing
from recorders.errors import JointError
from recorders.messages.message_types import JointState
from recorders.messages.topics import hands_among
from recorders.ticks.joiner import Tick, check_tick_topics

_HANDS = ("right", "left", "tail")
_ROBOT = "asimo"
_PERIOD_NS = 100_000_000
_TICKS = 6


class PairingRuleContract:
    """Tests of a rule, for a class that inherits them: all that training, golden cases and nodes rely on.

    Attributes
    ----------
    rule : PairingRule
        The rule, which must be registered.
    """

    rule: ClassVar[PairingRule]

    hands: int

    @pytest.fixture(autouse=True, params=range(1, 4), ids="hands-{}".format)
    def _of_hands(self, request: pytest.FixtureRequest) -> None:
        """Run each test with one hand, with two and with three."""
        self.hands = request.param

    def robot(self) -> RobotConfig:
        """Return a robot of so many hands; the links of some of them are the same."""
        robot = load_robot(_ROBOT)
        hands = (replace(robot.hands[place % 2], name=name) for place, name in enumerate(_HANDS[: self.hands]))
        return replace(robot, hands=tuple(hands))

    def room(self, robot: RobotConfig) -> tuple[Floats, Floats]:
        """Return arrays for u and d of a step."""
        return np.empty(3 * self.hands), np.empty(3 * self.hands + len(robot.joints))

    def tick(self, index: int, joints: tuple[str, ...]) -> Tick:
        """Return a tick whose numbers are all different from those of others."""
        start = 100.0 * index
        hands = tuple(start + 3.0 * hand + np.arange(3.0) for hand in range(self.hands))
        posture = JointState(index * _PERIOD_NS, joints, start + 50.0 + np.arange(float(len(joints))))
        return Tick(index * _PERIOD_NS, hands, posture, ())

    def steps(self, ticks: range, pending: Floats | None = None) -> tuple[list[tuple[int, bytes, bytes]], Floats]:
        """Return the steps of some ticks, after those that a checkpoint has seen, and what is pending then."""
        robot = self.robot()
        pairs = self.rule.pairs(robot)
        pairs.begin()
        if pending is not None:
            pairs.resume(pending)
        found = []
        for index in ticks:
            u, d = self.room(robot)
            if pairs.fill(self.tick(index, robot.joints), u, d):
                found.append((pairs.stamp_ns, u.tobytes(), d.tobytes()))
        return found, pairs.pending

    def test_it_is_registered(self) -> None:
        """It is found by its name, and its topics are those of a tick."""
        assert self.rule.name in PAIRING_RULES.names()
        assert find_pairing(self.rule.name) is self.rule
        topics = self.rule.topics(_HANDS[: self.hands])
        assert check_tick_topics(topics) == topics
        assert hands_among(topics) in {_HANDS[: self.hands], ()}

    def test_each_tick_makes_one_step_at_most(self) -> None:
        """Steps come in order, each stamped with its input."""
        steps, _ = self.steps(range(_TICKS))
        stamps = [stamp for stamp, _, _ in steps]
        assert 0 < len(steps) <= _TICKS
        assert stamps == sorted(set(stamps))
        assert set(stamps) <= {index * _PERIOD_NS for index in range(_TICKS)}

    def test_a_step_is_finite_and_of_its_own(self) -> None:
        """Every number of u and d is set, and no two steps are the same."""
        steps, _ = self.steps(range(_TICKS))
        for _, u, d in steps:
            assert np.isfinite(np.frombuffer(u + d)).all()
        assert len(set(steps)) == len(steps)

    @pytest.mark.parametrize("cut", range(_TICKS + 1))
    def test_going_on_from_what_was_pending_changes_no_bit(self, cut: int) -> None:
        """A checkpoint between two ticks keeps the u that waits, and nothing else."""
        first, pending = self.steps(range(cut))
        second, left = self.steps(range(cut, _TICKS), pending)
        whole, at_the_end = self.steps(range(_TICKS))
        assert pending.shape in {(0,), (3 * self.hands,)}
        assert [step[1:] for step in first + second] == [step[1:] for step in whole]
        assert left.tobytes() == at_the_end.tobytes()

    def test_a_cycle_begins_with_nothing(self) -> None:
        """Pending samples from before are forgotten."""
        robot = self.robot()
        pairs, (u, d) = self.rule.pairs(robot), self.room(robot)
        fresh = pairs.fill(self.tick(0, robot.joints), u, d)
        pairs.begin()
        assert pairs.pending.shape == (0,)
        assert pairs.fill(self.tick(1, robot.joints), u, d) == fresh

    def test_joints_are_mapped_by_name(self) -> None:
        """Their order in a message does not matter."""
        robot = self.robot()
        one, other = (self.rule.pairs(found) for found in (robot, replace(robot, joints=robot.joints[::-1])))
        (u, d), (mirrored_u, mirrored) = self.room(robot), self.room(robot)
        for index in range(2):
            taken = one.fill(self.tick(index, robot.joints), u, d)
            assert other.fill(self.tick(index, robot.joints), mirrored_u, mirrored) == taken
        joints = len(robot.joints)
        assert u.tolist() == mirrored_u.tolist()
        assert d[-joints:].tolist() == mirrored[-joints:][::-1].tolist()

    def test_a_tick_without_a_joint_is_refused_and_changes_nothing(self) -> None:
        """The next step is as if it had never come."""
        robot = self.robot()
        pairs, (u, d) = self.rule.pairs(robot), self.room(robot)
        pairs.fill(self.tick(0, robot.joints), u, d)
        before = pairs.pending
        with pytest.raises(JointError, match=robot.joints[-1]):
            pairs.fill(self.tick(1, robot.joints[:-1]), u, d)
        assert pairs.pending.tobytes() == before.tobytes()
