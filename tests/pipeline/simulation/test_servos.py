"""Servos without effort limits solve the equation of Drake's own, and are used as long as no motor is at its limit."""

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pipeline.arrays import Floats
from pipeline.robot.config import RobotConfig, load_robot
from pipeline.robot.kinematics import Kinematics
from pipeline.robot.resolution import UNLIMITED
from pipeline.simulation.servos import Demand, DrakePlant, Gains, SaturatedServos, UnsaturatedServos
from pipeline.simulation.simulation import Simulation

ROBOT = replace(load_robot("asimo"), resolution=UNLIMITED)
MS = 1_000_000
PERIOD = 5 * MS
N = len(ROBOT.joints)
INERTIAS = Kinematics(ROBOT).inertia_diagonal(ROBOT.comfort)
GAINS = Gains(900.0 * INERTIAS, 60.0 * INERTIAS)


def weak(robot: RobotConfig, joint: str, effort: float) -> RobotConfig:
    """The robot with another effort limit of one joint."""
    pattern = rf'(<joint name="{joint}".*?effort=")[^"]*'
    return replace(robot, urdf_text=re.sub(pattern, rf"\g<1>{effort}", robot.urdf_text, count=1, flags=re.DOTALL))


def demands(count: int, seed: int) -> list[Demand]:
    """Demands that jump about the comfort posture."""
    rng = np.random.default_rng(seed)
    return [
        Demand(ROBOT.comfort + rng.uniform(-0.02, 0.02, N), rng.uniform(-0.1, 0.1, N), INERTIAS * rng.uniform(-1, 1, N))
        for _ in range(count)
    ]


def solved(joints: DrakePlant, context: Any, q: Floats, v: Floats, demand: Demand) -> tuple[Floats, Floats]:
    """Posture and velocities after a millisecond, from the mass matrix and the forces that Drake names."""
    h = 1e-3
    joints.set_state(context, q, v)
    order = joints.v
    mass = joints.plant.CalcMassMatrixViaInverseDynamics(context)[np.ix_(order, order)]
    rest = joints.gravity(context) - joints.plant.CalcBiasTerm(context)[order]
    servo = GAINS.stiffness * (demand.positions - q) + GAINS.damping * demand.velocities + demand.feed_forward
    implicit = mass + h * np.diag(GAINS.damping + h * GAINS.stiffness)
    v = np.linalg.solve(implicit, mass @ v + h * (servo + rest))
    return q + h * v, v


def test_free_servos_solve_the_equation_that_they_name() -> None:
    servos = UnsaturatedServos(DrakePlant(ROBOT, step_ns=MS), GAINS)
    joints = DrakePlant(ROBOT, step_ns=MS)
    joints.finalize()
    context = joints.plant.CreateDefaultContext()
    q, v = ROBOT.comfort, np.zeros(N)
    servos.set_state(q, v, time_ns=0)
    for k, demand in enumerate(demands(40, seed=1), 1):
        assert servos.advance(demand, until_ns=k * PERIOD)
        for _ in range(PERIOD // MS):
            q, v = solved(joints, context, q, v, demand)
        np.testing.assert_allclose(servos.positions, q, rtol=0, atol=1e-13)
        np.testing.assert_allclose(servos.velocities, v, rtol=0, atol=1e-11)


def test_they_agree_with_drakes_own_as_far_as_those_iterate() -> None:
    free, limited = (
        UnsaturatedServos(DrakePlant(ROBOT, step_ns=MS), GAINS),
        SaturatedServos(DrakePlant(ROBOT, step_ns=MS), GAINS),
    )
    free.set_state(ROBOT.comfort, np.zeros(N), time_ns=0)
    for k, demand in enumerate(demands(200, seed=2)):
        begin, end = k * PERIOD, (k + 1) * PERIOD
        q, v = limited.advance(free.positions, free.velocities, demand, time_ns=begin, until_ns=end)
        assert free.advance(demand, until_ns=end)
        np.testing.assert_allclose(free.positions, q, rtol=0, atol=1e-8)
        np.testing.assert_allclose(free.velocities, v, rtol=0, atol=1e-5)


def efforts(joints: DrakePlant, context: Any, demand: Demand) -> Floats:
    """What every motor exerts in each millisecond of a period that begins at the comfort posture, shape (5, n)."""
    q, v, exerted = ROBOT.comfort, np.zeros(N), []
    for _ in range(PERIOD // MS):
        q, v = solved(joints, context, q, v, demand)
        pull = GAINS.stiffness * (demand.positions - q) + GAINS.damping * (demand.velocities - v)
        exerted.append(pull + demand.feed_forward)
    return np.array(exerted)


@pytest.mark.parametrize("begin", [0, 175 * MS])  # of these Drake's clock hits the one, and misses the other by a bit
def test_a_motor_beyond_its_limit_is_noticed_at_any_step_and_nothing_has_moved(begin: int) -> None:
    servos = UnsaturatedServos(DrakePlant(ROBOT, step_ns=MS), GAINS)
    joints = DrakePlant(ROBOT, step_ns=MS)
    joints.finalize()
    context = joints.plant.CreateDefaultContext()
    steps = set()
    for demand in demands(40, seed=3):
        exerted = np.abs(efforts(joints, context, demand))
        for factor, expected in ((1.0 + 1e-6, True), (1.0 - 1e-6, False)):
            servos.joints.effort_limits = exerted.max(axis=0) * factor
            servos.set_state(ROBOT.comfort, np.zeros(N), time_ns=begin)
            assert servos.advance(demand, until_ns=begin + PERIOD) == expected
            assert np.array_equal(servos.positions, ROBOT.comfort) != expected
        for joint in range(N):  # this motor alone
            servos.joints.effort_limits = np.where(np.arange(N) == joint, exerted.max(axis=0) * (1.0 - 1e-6), np.inf)
            servos.set_state(ROBOT.comfort, np.zeros(N), time_ns=begin)
            assert not servos.advance(demand, until_ns=begin + PERIOD)
        steps |= set(exerted.argmax(axis=0).tolist())
    assert {0, PERIOD // MS - 1} < steps


def test_a_motion_through_the_limits_has_the_same_bits_every_time() -> None:
    traces = []
    for begin in (0, 175 * MS, 0):
        simulation = Simulation(weak(ROBOT, "left_elbow", 2.0))
        simulation.reset(ROBOT.comfort, time_ns=begin)
        trace = []
        for k in range(60):
            simulation.advance(ROBOT.comfort - 0.3 * (k // 15 % 2), PERIOD)
            trace.append(np.concatenate([simulation.positions, simulation.velocities]))
        traces.append(np.array(trace))
    np.testing.assert_array_equal(traces[1], traces[0])
    np.testing.assert_array_equal(traces[2], traces[0])


@pytest.mark.parametrize("absurd", [1e12, 1e20, 1e100, 1.7e308, -1.7e308])
def test_an_absurd_command_takes_motors_to_their_limits_and_no_further(absurd: float) -> None:
    simulation = Simulation(ROBOT)
    simulation.advance(np.full(N, absurd), 2 * PERIOD)
    assert np.isfinite(simulation.positions).all()
    simulation.reset(ROBOT.comfort)
    simulation.advance(ROBOT.comfort, PERIOD)
    np.testing.assert_allclose(simulation.positions, ROBOT.comfort, rtol=0, atol=1e-6)


def test_what_is_asked_of_a_simulation_is_a_copy() -> None:
    simulation = Simulation(ROBOT)
    simulation.positions[:] = 9.0
    simulation.velocities[:] = 9.0
    np.testing.assert_array_equal(simulation.positions, ROBOT.comfort)
    np.testing.assert_array_equal(simulation.velocities, 0.0)


def test_an_arm_whose_motor_is_too_weak_sinks_as_far_as_drake_says() -> None:
    joint = ROBOT.joints.index("left_shoulder_pitch")
    robot = weak(ROBOT, "left_shoulder_pitch", 1.0)
    simulation, strong = Simulation(robot), Simulation(ROBOT)
    limited = SaturatedServos(DrakePlant(robot, step_ns=MS), GAINS)
    joints = DrakePlant(robot, step_ns=MS)
    joints.finalize()
    context = joints.plant.CreateDefaultContext()
    q, v = ROBOT.comfort, np.zeros(N)
    for k in range(60):
        joints.set_state(context, q, v)
        hold = Demand(ROBOT.comfort, np.zeros(N), -joints.gravity(context))
        q, v = limited.advance(q, v, hold, time_ns=k * PERIOD, until_ns=(k + 1) * PERIOD)
        simulation.advance(ROBOT.comfort, PERIOD)
        strong.advance(ROBOT.comfort, PERIOD)
        np.testing.assert_allclose(simulation.positions, q, rtol=0, atol=1e-6)
    assert abs(simulation.positions - ROBOT.comfort)[joint] > 0.1
    np.testing.assert_allclose(strong.positions, ROBOT.comfort, rtol=0, atol=1e-6)


def test_a_motor_that_is_at_its_limit_for_a_while_comes_back() -> None:
    weaker, strong = Simulation(weak(ROBOT, "left_elbow", 2.0)), Simulation(ROBOT)
    elbow = ROBOT.joints.index("left_elbow")
    goal = ROBOT.comfort.copy()
    goal[elbow] -= 0.5
    for simulation in (weaker, strong):
        simulation.advance(goal, 100 * MS)
    assert weaker.positions[elbow] - strong.positions[elbow] > 0.01  # it is behind
    weaker.advance(goal, 2_000 * MS)
    np.testing.assert_allclose(weaker.positions, goal, rtol=0, atol=1e-4)
