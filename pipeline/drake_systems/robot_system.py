"""The simulated robot as one system of Drake: joint commands in, what its sensors measure out."""

from typing import Any, NamedTuple

import numpy as np
from pydrake.systems.framework import Context, Diagram, DiagramBuilder, LeafSystem

from pipeline.arrays import Floats
from pipeline.drake_systems.commanding import JOINT_COMMANDS, MEASURED_JOINTS
from pipeline.drake_systems.sampled import SampledSystem, read
from pipeline.robot.config import RobotConfig
from pipeline.robot.coordinates import centre_rows
from pipeline.robot.resolution import on_grid
from pipeline.simulation.servos import DrakePlant, Gains, add_servos, known_forces
from pipeline.simulation.simulation import SimulationConfig, hand_rows, next_demand, servo_gains
from recorders.errors import RobotError

MEASURED_VELOCITIES, MEASURED_HANDS = "measured_velocities", "measured_hands"
"""Names of further ports: of sizes n [rad/s or m/s] and 3 hands [m]."""

_SIMULATION = SimulationConfig()
_STATE, _FORCES = "state", "forces"


class RobotSystem(Diagram):
    """The robot that `Simulation` simulates, in a diagram: the same plant, servos, lag, gravity and sensors.

    Input port `joint_commands` (n); output ports `measured_joints` (n), `measured_velocities` (n) and `measured_hands`
    (3 hands), in the order of ``robot.joints`` and ``robot.hands``. Motors have no effort limits here, so a motor
    that would need more than its own is an error. A diagram with contact has a plant of its own: `add_servos` and
    `ServoSystem` go with any.

    Parameters
    ----------
    robot : RobotConfig
        The robot.
    config : SimulationConfig
        Steps, lag and bandwidth.

    Raises
    ------
    RobotError
        Drake cannot build the URDF, or finds no motor for a joint; while it is simulated: a motor is beyond its limit.
    """

    def __init__(self, robot: RobotConfig, config: SimulationConfig = _SIMULATION) -> None:
        super().__init__()
        self._joints = joints = DrakePlant(robot, step_ns=config.step_ns)
        gains, builder = servo_gains(robot, config.bandwidth), DiagramBuilder()
        forces = add_servos(builder, joints, gains)
        servos = builder.AddSystem(ServoSystem(robot, joints, gains, config))
        sensors = builder.AddSystem(SensorSystem(robot, joints))
        state = joints.plant.get_state_output_port()
        builder.Connect(state, servos.GetInputPort(_STATE))
        builder.Connect(state, sensors.GetInputPort(_STATE))
        builder.Connect(servos.GetOutputPort(_FORCES), forces)
        builder.ExportInput(servos.GetInputPort(JOINT_COMMANDS), JOINT_COMMANDS)
        for name in (MEASURED_JOINTS, MEASURED_VELOCITIES, MEASURED_HANDS):
            builder.ExportOutput(sensors.GetOutputPort(name), name)
        builder.BuildInto(self)

    def set_posture(self, root: Context, q: Floats) -> None:
        """Let the robot stand still at posture `q` (n,), in the context of the whole diagram."""
        own = self._joints.plant.GetMyMutableContextFromRoot(root)
        self._joints.set_state(own, np.asarray(q, dtype=np.float64), np.zeros(len(q)))


class _Drive(NamedTuple):
    """What servos hold for a control period: set point (n,) after it, and known part of their forces (n,)."""

    set_point: Floats
    known: Floats


class ServoSystem(SampledSystem[_Drive]):
    """Lag, gravity feed-forward and set points of the servos, renewed every control period.

    Input ports `joint_commands` (n) and `state`, the plant's; output port `forces` for what `add_servos` returns.
    """

    def __init__(self, robot: RobotConfig, joints: DrakePlant, gains: Gains, config: SimulationConfig) -> None:
        super().__init__(config.control_ns)
        self._robot, self._joints, self._gains, self._config = robot, joints, gains, config
        self._context = joints.plant.CreateDefaultContext()  # to compute with
        self._commands = self.DeclareVectorInputPort(JOINT_COMMANDS, len(robot.joints))
        self._state_port = self.DeclareVectorInputPort(_STATE, joints.plant.num_multibody_states())
        self.DeclareVectorOutputPort(_FORCES, joints.plant.num_velocities(), self._forces)
        step_s = config.step_ns * 1e-9
        self.DeclarePeriodicPublishEvent(step_s, step_s, self._check_efforts)

    def compute(self, context: Context, held: _Drive | None) -> _Drive:
        """Renew what the servos hold."""
        joints, plant = self._joints, self._joints.plant
        plant.SetPositionsAndVelocities(self._context, read(self._state_port, context))
        set_point = joints.positions(self._context) if held is None else held.set_point
        command = on_grid(read(self._commands, context), self._robot.resolution.commands)
        set_point, demand = next_demand(command, set_point, joints.gravity(self._context), self._config)
        return _Drive(set_point, known_forces(demand, self._gains))

    def _forces(self, context: Context, out: Any) -> None:
        forces = np.zeros(self._joints.plant.num_velocities())
        forces[self._joints.v] = self.held(context).known
        out.SetFromVector(forces)

    def _check_efforts(self, context: Context) -> None:
        """Check the efforts of the step that has just ended; the tick that may begin now is not taken in yet."""
        if (drive := self.last(context)) is None:
            return
        q, v = np.split(read(self._state_port, context)[self._joints.x], 2)
        exerted = drive.known - (self._gains.stiffness * q + self._gains.damping * v)
        if (beyond := np.abs(exerted) > self._joints.effort_limits).any():
            joint = int(np.flatnonzero(beyond)[0])
            raise RobotError(
                f"robot '{self._robot.name}': the motor of joint {self._robot.joints[joint]} would exert "
                f"{abs(exerted[joint]):g}, expected at most {self._joints.effort_limits[joint]:g}: motors in a "
                "diagram have no effort limits; choose a slower motion, or Simulation"
            )


class SensorSystem(LeafSystem):
    """Sensors of a robot: input port `state`, the plant's; outputs as `RobotSystem` has them."""

    def __init__(self, robot: RobotConfig, joints: DrakePlant) -> None:
        super().__init__()
        self._robot, self._joints = robot, joints
        self._context = joints.plant.CreateDefaultContext()  # to compute with
        self._bodies = [joints.body(hand.link) for hand in robot.hands]
        self._state_port = self.DeclareVectorInputPort(_STATE, joints.plant.num_multibody_states())
        n = len(robot.joints)
        self.DeclareVectorOutputPort(MEASURED_JOINTS, n, self._positions)
        self.DeclareVectorOutputPort(MEASURED_VELOCITIES, n, self._velocities)
        self.DeclareVectorOutputPort(MEASURED_HANDS, centre_rows(robot).size, self._hands)

    def _positions(self, context: Context, out: Any) -> None:
        q, _ = np.split(read(self._state_port, context)[self._joints.x], 2)
        out.SetFromVector(on_grid(q, self._robot.resolution.positions))

    def _velocities(self, context: Context, out: Any) -> None:
        _, v = np.split(read(self._state_port, context)[self._joints.x], 2)
        out.SetFromVector(on_grid(v, self._robot.resolution.velocities))

    def _hands(self, context: Context, out: Any) -> None:
        plant: Any = self._joints.plant
        plant.SetPositionsAndVelocities(self._context, read(self._state_port, context))
        poses = [plant.EvalBodyPoseInWorld(self._context, body) for body in self._bodies]
        out.SetFromVector(on_grid(hand_rows(self._robot, poses), self._robot.resolution.hands).ravel())
