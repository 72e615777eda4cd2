"""Tests that every drawn motion passes; needs pytest, and a test class of one's own with a `source`."""

from functools import cached_property
from typing import ClassVar

import numpy as np

from pipeline.exploration.source import SOURCES, DrawnMotion
from pipeline.exploration.source import source as source_of
from pipeline.motions.motion import Motion, check_targets
from pipeline.robot.config import RobotConfig, load_robot
from pipeline.robot.kinematics import Kinematics
from pipeline.teacher.teacher import Teacher, check_reach

_DURATION_S = 3.0
_TICK_RATE_HZ = 10


class DrawnMotionContract:
    """Tests of a source, for a class that inherits them: all that `explore` relies on.

    Attributes
    ----------
    source : DrawnMotion
        The source, which must be registered.
    robot : str
        The robot that it draws for.
    """

    source: ClassVar[DrawnMotion]
    robot: ClassVar[str] = "asimo"

    @cached_property
    def config(self) -> RobotConfig:
        """The robot."""
        return load_robot(self.robot)

    def drawn(self, seed: int) -> Motion:
        """Draw a motion."""
        wanted = source_of(self.source.name, duration_s=_DURATION_S, tick_rate_hz=_TICK_RATE_HZ)
        return wanted.motion(self.config, seed=seed)

    def test_it_is_registered(self) -> None:
        """It is found by its name, with its own settings."""
        assert self.source.name in SOURCES.names()
        wanted = source_of(self.source.name)
        assert SOURCES.find(self.source.name) is self.source
        assert (wanted.teacher, wanted.config, wanted.drawn) == (self.source.teacher, self.source.config, True)

    def test_the_seed_names_the_motion(self) -> None:
        """The same to the bit, and another for another seed."""
        one, again, other = self.drawn(1), self.drawn(1), self.drawn(2)
        assert one.sha256 == again.sha256 != other.sha256

    def test_length_and_rate_are_as_asked_for(self) -> None:
        """One sample a tick, each hand's."""
        made = self.drawn(3)
        assert np.allclose(np.diff(made.times_s), 1.0 / _TICK_RATE_HZ)
        assert abs(len(made) - _DURATION_S * _TICK_RATE_HZ) <= 1
        assert made.targets.shape[1:] == (len(self.config.hands), 3)

    def test_the_robot_reaches_it(self) -> None:
        """Targets can be the robot's, and the teacher follows them."""
        made = self.drawn(4)
        check_targets(made, self.config)
        check_reach(Teacher(Kinematics(self.config), self.source.teacher), made)
