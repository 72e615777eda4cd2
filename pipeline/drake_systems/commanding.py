"""Systems that lead a robot: hand targets and measured joints in, joint commands out."""

import math
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike
from pydrake.systems.framework import Context

from pipeline.arrays import Floats
from pipeline.drake_systems.sampled import SampledSystem, read
from pipeline.evaluation.errors import WASHOUT_STEPS
from pipeline.evaluation.trials import robot_of
from pipeline.learner.controller import Controller
from pipeline.robot.config import RobotConfig
from pipeline.robot.coordinates import centre_rows, to_inputs

HAND_TARGETS, MEASURED_JOINTS, JOINT_COMMANDS = "hand_targets", "measured_joints", "joint_commands"
"""Names of the ports: of sizes 3 hands [m] (7 hands if the pose of one is controlled), n and n [rad or m]."""


class SteppingTeacher(Protocol):
    """A teacher that goes on from the posture that it commanded last."""

    @property
    def period_ns(self) -> int:
        """Control period [ns]."""
        ...

    def step(self, q: ArrayLike, targets: ArrayLike) -> Floats:
        """Return the posture to command one period after `q` (n,), for hand `targets` [m] (hands, 3)."""
        ...


class TeacherSystem(SampledSystem[Floats]):
    """A teacher in a diagram: input ports `hand_targets` and `measured_joints`, output port `joint_commands`.

    Where the joints are measured counts once: from there it goes on to its first command, unless a start is given.

    Parameters
    ----------
    robot : RobotConfig
        The robot that it leads.
    teacher : SteppingTeacher
        The teacher, such as `Teacher` or `QpTeacher`.
    start : array, shape (n,), optional
        Posture to begin from [rad or m].
    """

    def __init__(self, robot: RobotConfig, teacher: SteppingTeacher, *, start: Floats | None = None) -> None:
        super().__init__(teacher.period_ns)
        self._teacher, self._start = teacher, start
        self._shape = centre_rows(robot).shape
        self._targets = self.DeclareVectorInputPort(HAND_TARGETS, math.prod(self._shape))
        self._measured = self.DeclareVectorInputPort(MEASURED_JOINTS, len(robot.joints))
        self.DeclareVectorOutputPort(JOINT_COMMANDS, len(robot.joints), self._command)

    def compute(self, context: Context, held: Floats | None) -> Floats:
        """Return the teacher's next command."""
        posture = self._start if held is None else held
        if posture is None:
            posture = read(self._measured, context)
        return self._teacher.step(posture, read(self._targets, context).reshape(self._shape))

    def _command(self, context: Context, out: Any) -> None:
        out.SetFromVector(self.held(context))


class _Answer(NamedTuple):
    """State of a learner after a step, and the command (n,) that the step came to."""

    state: dict[str, Floats]
    command: Floats


class ControllerSystem(SampledSystem[_Answer]):
    """A learned controller in a diagram, with the ports of a teacher; it answers as `serve` does without learning.

    It takes a step at every tick, and begins with a washout on its first target. Commands stay within the joints'
    limits. It needs no measured joints: this port may be left unconnected.

    Parameters
    ----------
    controller : Controller
        What was learned; the robot is the one that it carries.
    period_ns : int
        From tick to tick [ns]: as long as a target was held while it learned.

    Raises
    ------
    ControllerError, RobotError
        The controller is not for the joints of its own robot.
    """

    def __init__(self, controller: Controller, *, period_ns: int) -> None:
        super().__init__(period_ns)
        self._robot = robot_of(controller)
        self._learner = controller.learner()
        self._first = self._learner.state()
        self._targets = self.DeclareVectorInputPort(HAND_TARGETS, centre_rows(self._robot).size)
        self.DeclareVectorInputPort(MEASURED_JOINTS, len(self._robot.joints))
        self.DeclareVectorOutputPort(JOINT_COMMANDS, len(self._robot.joints), self._command)

    def compute(self, context: Context, held: _Answer | None) -> _Answer:
        """Take a step from the state before it."""
        rows = read(self._targets, context).reshape(centre_rows(self._robot).shape)
        u = to_inputs(self._robot, rows)
        self._learner.load_state(self._first if held is None else held.state)
        if held is None:
            self._learner.washout(u, steps=WASHOUT_STEPS)
        joints = self._learner.predict(u[np.newaxis])[0, -len(self._robot.joints) :]
        return _Answer(self._learner.state(), np.clip(joints, self._robot.lower, self._robot.upper))

    def _command(self, context: Context, out: Any) -> None:
        out.SetFromVector(self.held(context).command)
