"""Tests that every motion by name passes; needs pytest, and a test class of one's own with a `motion`."""

from typing import ClassVar

from pipeline.motions.motion import MOTIONS, Motion, NamedMotion, check_targets, load_motion
from pipeline.robot.config import RobotConfig, load_robot


class NamedMotionContract:
    """Tests of a motion, for a class that inherits them: all that exploration, evaluation and deployment rely on.

    Attributes
    ----------
    motion : NamedMotion
        The motion, which must be registered.
    robot : str
        The robot that it is made for.
    """

    motion: ClassVar[NamedMotion]
    robot: ClassVar[str] = "asimo"

    @property
    def config(self) -> RobotConfig:
        """The robot."""
        return load_robot(self.robot)

    def presented(self) -> Motion:
        """Make the motion."""
        return self.motion.make(self.config)

    def test_it_is_registered(self) -> None:
        """It is found by its name, and loaded as any other."""
        assert self.motion.name in MOTIONS.names()
        assert MOTIONS.find(self.motion.name) is self.motion
        assert load_motion(self.motion.name, self.config).sha256 == self.presented().sha256

    def test_it_has_its_name_and_the_robots_hands(self) -> None:
        """Targets of every hand, in the robot's order."""
        presented = self.presented()
        assert presented.name == self.motion.name
        assert presented.targets.shape == (len(presented), len(self.config.hands), 3)

    def test_it_is_the_same_each_time(self) -> None:
        """To the bit."""
        assert self.presented().targets.tobytes() == self.presented().targets.tobytes()
        assert self.presented().times_s.tobytes() == self.presented().times_s.tobytes()

    def test_its_targets_can_be_the_robots(self) -> None:
        """None is far from the robot."""
        check_targets(self.presented(), self.config)
