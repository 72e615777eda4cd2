"""The servos of a simulated robot, in Drake: every joint under PD control, its motor within its effort limit."""

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple
from xml.etree.ElementTree import tostring

import numpy as np
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import DiscreteContactApproximation, MultibodyPlant
from pydrake.multibody.tree import PdControllerGains
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder, TriggerType
from pydrake.systems.primitives import Adder, LogVectorOutput, MatrixGain

from pipeline.arrays import Floats
from pipeline.robot.config import RobotConfig
from pipeline.urdf.description import WORLD, canonical, root_link
from pipeline.urdf.model_names import for_libraries, joint_name, link_name
from recorders.errors import RobotError
from recorders.text.wording import line_text, names_text


class Gains(NamedTuple):
    """Gains of the servos, each of shape (n,) in the order of ``robot.joints``.

    Attributes
    ----------
    stiffness : ndarray
        [N m/rad or N/m].
    damping : ndarray
        [N m s/rad or N s/m].
    """

    stiffness: Floats
    damping: Floats


class Demand(NamedTuple):
    """Demand on the servos for a while, each field of shape (n,).

    Attributes
    ----------
    positions, velocities : ndarray
        Desired ones [rad, rad/s or m, m/s].
    feed_forward : ndarray
        Added to what the servos exert [N m or N].
    """

    positions: Floats
    velocities: Floats
    feed_forward: Floats


class DrakePlant:
    """A Drake plant, without contact, seen in the order of ``robot.joints``, whatever order Drake has.

    Attributes
    ----------
    plant, model : object
        The plant, and its only model instance.
    joints, motors : list of object
        Those of Drake.
    effort_limits : ndarray
        Of the motors [N m or N], shape (n,).
    step_ns : int
        Step of the dynamics [ns].
    v : ndarray of int
        Places of the joints among the plant's velocities, shape (n,); from `finalize` on.
    x : ndarray of int
        Places of their positions, then velocities, in the plant's state, shape (2 n,); from `finalize` on.

    Raises
    ------
    RobotError
        Drake cannot build the URDF, or finds no motor for a joint.
    """

    def __init__(self, robot: RobotConfig, *, step_ns: int) -> None:
        self.step_ns = step_ns
        self.plant: Any = MultibodyPlant(time_step=step_ns * 1e-9)  # Any: Drake's types for arrays are not numpy's
        self.plant.set_discrete_contact_approximation(DiscreteContactApproximation.kSap)
        self.plant.SetUseSampledOutputPorts(False)  # nothing reads accelerations or reaction forces
        urdf = canonical(robot.urdf_text)
        text = tostring(for_libraries(urdf), encoding="unicode")
        try:
            with _no_substitutes():
                (self.model,) = Parser(self.plant).AddModelsFromString(text, "urdf")
        except (RuntimeError, ValueError) as error:
            raise RobotError(
                f"robot '{robot.name}': the URDF does not build: {line_text(str(error), limit=1000)}"
            ) from error
        if (root := root_link(urdf)) != WORLD:
            self.plant.WeldFrames(self.plant.world_frame(), self.body(root).body_frame())
        found = {
            motor.joint().name(): motor
            for motor in map(self.plant.get_joint_actuator, self.plant.GetJointActuatorIndices())
        }
        if unmoved := [name for name in robot.joints if joint_name(name) not in found]:
            raise RobotError(
                f"robot '{robot.name}': Drake makes no motor for {names_text(unmoved)}: expected a transmission "
                "of type transmission_interface/SimpleTransmission and an effort limit above 0"
            )
        self.joints: list[Any] = [self.plant.GetJointByName(joint_name(name)) for name in robot.joints]
        self.motors = [found[joint_name(name)] for name in robot.joints]
        self.effort_limits = np.array([motor.effort_limit() for motor in self.motors])

    def body(self, link: str) -> Any:
        """Drake's body of a link of the URDF."""
        return self.plant.GetBodyByName(link_name(link))

    def finalize(self) -> None:
        """Let Drake number the joints; nothing can be added to the plant from here on."""
        self.plant.Finalize()
        self._q = np.array([joint.position_start() for joint in self.joints])
        self.v = np.array([joint.velocity_start() for joint in self.joints])
        self.x = np.concatenate([self._q, self.plant.num_positions() + self.v])  # in the plant's state [q; v]

    def positions(self, context: Any) -> Floats:
        """Joint positions [rad or m], shape (n,)."""
        positions: Floats = self.plant.GetPositions(context)[self._q]
        return positions

    def velocities(self, context: Any) -> Floats:
        """Joint velocities [rad/s or m/s], shape (n,)."""
        velocities: Floats = self.plant.GetVelocities(context)[self.v]
        return velocities

    def gravity(self, context: Any) -> Floats:
        """Gravity's forces on the joints [N m or N], shape (n,)."""
        forces: Floats = self.plant.CalcGravityGeneralizedForces(context)[self.v]
        return forces

    def set_state(self, context: Any, q: Floats, v: Floats) -> None:
        """Set positions and velocities, both (n,)."""
        state = np.zeros(self.plant.num_multibody_states())
        state[self.x] = np.concatenate([q, v])
        self.plant.SetPositionsAndVelocities(context, state)


@contextmanager
def _no_substitutes() -> Iterator[None]:
    """Raise ValueError where Drake, with a warning, takes an inertia of its own for one of the URDF's."""
    found: list[str] = []
    handler = logging.Handler(logging.WARNING)
    handler.emit = lambda record: found.append(record.getMessage())  # type: ignore[method-assign]
    logger = logging.getLogger("drake")
    level, propagate = logger.level, logger.propagate
    logger.addHandler(handler)
    logger.setLevel(logging.WARNING)
    logger.propagate = False  # its remarks on the URDF are not for our users
    try:
        yield
    finally:
        logger.removeHandler(handler)
        logger.setLevel(level)
        logger.propagate = propagate
    if wrong := [line for line in found if "inertia" in line]:
        raise ValueError(wrong[0])


class SaturatedServos:
    """Servos as Drake has them, with effort limits, for which every step is solved by iteration.

    Parameters
    ----------
    joints : DrakePlant
        Not finalized; taken over.
    gains : Gains
        Of the servos.
    """

    def __init__(self, joints: DrakePlant, gains: Gains) -> None:
        self._joints = joints
        for motor, stiffness, damping in zip(joints.motors, *gains, strict=True):
            motor.set_controller_gains(PdControllerGains(p=stiffness, d=damping))
        joints.finalize()
        self._inputs = np.array([motor.input_start() for motor in joints.motors])
        self._simulator = Simulator(joints.plant)
        self._context = self._simulator.get_mutable_context()

    def advance(self, q: Floats, v: Floats, demand: Demand, *, time_ns: int, until_ns: int) -> tuple[Floats, Floats]:
        """Return positions and velocities (n,) at `until_ns`, from those that are at `time_ns`."""
        joints, n = self._joints, len(q)
        desired, feed_forward = np.empty(2 * n), np.empty(n)  # [q; v] in the order of the motors
        desired[self._inputs], desired[self._inputs + n] = demand.positions, demand.velocities
        feed_forward[self._inputs] = demand.feed_forward
        self._context.SetTime(time_ns / 1_000_000_000)
        joints.set_state(self._context, q, v)
        joints.plant.get_desired_state_input_port(joints.model).FixValue(self._context, desired)
        joints.plant.get_actuation_input_port().FixValue(self._context, feed_forward)
        self._simulator.Initialize()
        self._simulator.AdvanceTo(until_ns / 1_000_000_000)
        return joints.positions(self._context), joints.velocities(self._context)


def known_forces(demand: Demand, gains: Gains) -> Floats:
    """Return the part of the servos' forces that does not depend on the state [N m or N], shape (n,)."""
    return gains.stiffness * demand.positions + gains.damping * demand.velocities + demand.feed_forward


def add_servos(builder: DiagramBuilder, joints: DrakePlant, gains: Gains) -> Any:
    """Add a plant and servos without effort limits to a diagram; returns the input port for what they are to exert.

    In a step of length h from q and v, a servo exerts  K (q_d - q - h v') + D (v_d - v'),  where v' is the velocity
    after it. All that depends on v' is joint damping, of D + h K, which Drake has in the mass matrix of a discrete
    step. -K q is fed back from the state. What is left, `known_forces` in the order of the plant's velocities, goes
    into the port.

    Parameters
    ----------
    builder : DiagramBuilder
        Of the diagram.
    joints : DrakePlant
        Not finalized; taken over.
    gains : Gains
        Of the servos.
    """
    plant, n = joints.plant, len(joints.joints)
    for joint, stiffness, damping in zip(joints.joints, *gains, strict=True):
        (own,) = joint.default_damping_vector()
        joint.set_default_damping_vector(np.array([own + damping + stiffness * plant.time_step()]))
    builder.AddSystem(plant)
    joints.finalize()
    springs = np.zeros((plant.num_velocities(), plant.num_multibody_states()))
    springs[joints.v, joints.x[:n]] = -gains.stiffness
    feedback, sum_of_forces = MatrixGain(springs), Adder(2, plant.num_velocities())
    builder.AddSystem(feedback)
    builder.AddSystem(sum_of_forces)
    builder.Connect(plant.get_state_output_port(), feedback.get_input_port())
    builder.Connect(feedback.get_output_port(), sum_of_forces.get_input_port(0))
    builder.Connect(sum_of_forces.get_output_port(), plant.get_applied_generalized_force_input_port())
    return sum_of_forces.get_input_port(1)


class UnsaturatedServos:
    """Servos without effort limits: the same equation, which is linear then, and solved in one go, by `add_servos`.

    Only a joint at the end of its range takes iterations.

    Parameters
    ----------
    joints : DrakePlant
        Not finalized; taken over.
    gains : Gains
        Of the servos.

    Attributes
    ----------
    joints : DrakePlant
        The same.
    context : Context
        Its state in Drake.
    time_ns : int
        Its time [ns].
    """

    def __init__(self, joints: DrakePlant, gains: Gains) -> None:
        self.joints = joints
        self._gains = gains
        builder = DiagramBuilder()
        builder.ExportInput(add_servos(builder, joints, gains))
        plant, n = joints.plant, len(joints.joints)
        log = LogVectorOutput(plant.get_state_output_port(), builder, {TriggerType.kPerStep})
        self._simulator = Simulator(builder.Build())
        root = self._simulator.get_mutable_context()
        self._steps = log.FindMutableLog(root)  # the state after every step
        self._known = np.zeros(plant.num_velocities())
        self._input: Any = self._simulator.get_system().get_input_port().FixValue(root, self._known)
        self.context = plant.GetMyMutableContextFromRoot(root)
        self._state, self.time_ns = np.zeros(2 * n), 0

    @property
    def positions(self) -> Floats:
        """Joint positions [rad or m], shape (n,)."""
        return self._state[: len(self._state) // 2].copy()

    @property
    def velocities(self) -> Floats:
        """Joint velocities [rad/s or m/s], shape (n,)."""
        return self._state[len(self._state) // 2 :].copy()

    def set_state(self, q: Floats, v: Floats, *, time_ns: int) -> None:
        """Set positions and velocities, both (n,), and the time [ns]."""
        self._state, self.time_ns = np.concatenate([q, v]), time_ns
        self._simulator.get_mutable_context().SetTime(time_ns / 1_000_000_000)
        self.joints.set_state(self.context, q, v)
        self._simulator.Initialize()

    def advance(self, demand: Demand, *, until_ns: int) -> bool:
        """Advance to a time [ns], if every motor can; returns whether each was within its effort limit at every step.

        If not, positions and velocities are still those before, and have to be placed anew.
        """
        with np.errstate(over="ignore", invalid="ignore"):  # of what is absurd: it takes motors to their limits
            return self._advance(demand, until_ns)

    def _advance(self, demand: Demand, until_ns: int) -> bool:
        stiffness, damping = self._gains
        known = known_forces(demand, self._gains)
        self._known[self.joints.v] = known
        self._input.GetMutableData().get_mutable_value().SetFromVector(self._known)
        self._steps.Clear()
        try:
            self._simulator.AdvanceTo(until_ns / 1_000_000_000, interruptible=False)
        except RuntimeError:  # numbers that Drake cannot go on with
            return False
        n, count = len(known), (until_ns - self.time_ns) // self.joints.step_ns
        states = self._steps.data().T[-count:, self.joints.x]  # (steps, 2 n); before them may stand what was
        exerted = known - (stiffness * states[:, :n] + damping * states[:, n:])
        if not (np.abs(exerted) <= self.joints.effort_limits).all():
            return False
        self._state, self.time_ns = states[-1].copy(), until_ns
        return True
