"""Robot and teacher as one Drake diagram give the log of `explore`; controllers in a diagram answer as served ones."""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from episodes import write_episode
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource, LogVectorOutput

from pipeline.arrays import Floats
from pipeline.drake_systems.commanding import ControllerSystem, SteppingTeacher, TeacherSystem
from pipeline.drake_systems.robot_system import RobotSystem
from pipeline.drake_systems.target_source import TargetSource
from pipeline.evaluation.errors import predicted_joints
from pipeline.exploration.episode import ExplorationConfig, Guidance, MotionPlan, plan, start_posture
from pipeline.exploration.explore import explore
from pipeline.learner.controller import Controller
from pipeline.learner.rules.forward_inverse.config import ForwardInverseConfig
from pipeline.learner.rules.reservoir.config import LearnerConfig
from pipeline.motions.motion import Motion
from pipeline.robot.config import load_robot
from pipeline.robot.kinematics import Kinematics
from pipeline.robot.resolution import on_grid
from pipeline.samples.pairing import COMMANDED
from pipeline.teacher.qp_teacher import QpTeacher
from pipeline.teacher.teacher import Teacher
from pipeline.training.trainer import train
from recorders.cdr.codec import decode_as
from recorders.errors import ConfigError, RobotError
from recorders.messages.message_types import JointState, PoseStamped
from recorders.messages.topics import JOINT_COMMANDS, JOINT_STATES, SAMPLE_JOINTS, hand_measured
from recorders.reading.reader import LogReader
from replay.sources.schedule import Schedule

ROBOT = load_robot("asimo")
N = len(ROBOT.joints)
MS = 1_000_000
CONFIG = ExplorationConfig(settle_ns=200 * MS)
SEED = 3


def motion() -> Motion:
    """Both hands go up, to the side and back within 0.8 s."""
    steps = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.03], [0.0, 0.04, 0.03], [0.01, 0.0, 0.0]])
    return Motion("short", 0.2 * np.arange(4), ROBOT.centres + steps[:, np.newaxis], closed=False)


class Traces(NamedTuple):
    """What the ports put out every 20 ms from time 0 on, by name, each (T, size)."""

    measured_joints: Floats
    measured_velocities: Floats
    measured_hands: Floats
    joint_commands: Floats


def simulate(teacher: SteppingTeacher, motion_plan: MotionPlan, start: Floats) -> Traces:
    """Simulate robot and teacher as one diagram, from a start posture through a plan."""
    holds = [*motion_plan.settling, *motion_plan.holds]
    builder = DiagramBuilder()
    source = builder.AddSystem(TargetSource([hold.target for hold in holds], [hold.duration_ns for hold in holds]))
    guide = builder.AddSystem(TeacherSystem(ROBOT, teacher, start=start))
    robot = RobotSystem(ROBOT)
    builder.AddSystem(robot)
    builder.Connect(source.GetOutputPort("hand_targets"), guide.GetInputPort("hand_targets"))
    builder.Connect(robot.GetOutputPort("measured_joints"), guide.GetInputPort("measured_joints"))
    builder.Connect(guide.GetOutputPort("joint_commands"), robot.GetInputPort("joint_commands"))
    ports = [robot.GetOutputPort(name) for name in Traces._fields[:3]] + [guide.GetOutputPort("joint_commands")]
    logs = [LogVectorOutput(port, builder, CONFIG.state_period_ns * 1e-9) for port in ports]
    simulator = Simulator(builder.Build())
    context = simulator.get_mutable_context()
    robot.set_posture(context, start)
    simulator.AdvanceTo((motion_plan.settling_ns + motion_plan.cycle_ns) * 1e-9)
    return Traces(*(log.FindLog(context).data().T for log in logs))


def logged(log: Path, topic: str) -> list[JointState]:
    return [decode_as(JointState, record.data) for record in LogReader(log).records(topics=[topic])]


def same(found: Floats, expected: Any) -> None:
    """Check equality within rounding."""
    np.testing.assert_allclose(found, np.array(expected), rtol=0, atol=1e-9)


@pytest.mark.parametrize("kind", [Teacher, QpTeacher])
def test_robot_and_teacher_in_one_diagram_give_the_log_of_explore(tmp_path: Path, kind: type) -> None:
    teacher = Teacher(Kinematics(ROBOT)) if kind is Teacher else QpTeacher(ROBOT)
    log = tmp_path / "log.mcap"
    explore(ROBOT, motion(), seed=SEED, out=log, config=CONFIG, guidance=Guidance(teacher))
    motion_plan = plan(motion(), period_ns=teacher.period_ns, settle_ns=CONFIG.settle_ns)
    traces = simulate(teacher, motion_plan, start_posture(ROBOT, seed=SEED, spread=CONFIG.start_spread))
    settled = CONFIG.settle_ns // CONFIG.state_period_ns
    states, commands = logged(log, JOINT_STATES), logged(log, JOINT_COMMANDS)
    assert len(states) == len(commands) + 1 == 41 == len(traces.measured_joints) - settled
    same(traces.measured_joints[settled:], [state.position for state in states])
    same(traces.measured_velocities[settled:], [state.velocity for state in states])
    same(
        on_grid(traces.joint_commands[settled:-1], ROBOT.resolution.commands),
        [command.position for command in commands],
    )
    ticks = slice(settled, None, 10)
    same(traces.measured_joints[ticks], [tick.position for tick in logged(log, SAMPLE_JOINTS)])
    for place, name in enumerate(ROBOT.hand_names):
        records = LogReader(log).records(topics=[hand_measured(name)])
        measured = [decode_as(PoseStamped, record.data).position for record in records]
        same(traces.measured_hands[ticks, 3 * place : 3 * place + 3], measured)


@pytest.fixture(scope="module", params=[LearnerConfig(), ForwardInverseConfig()], ids=lambda config: config.rule)
def controller(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Controller:
    log = write_episode(tmp_path_factory.mktemp("log") / "log.mcap")
    return train([log], schedule=Schedule(epochs=1), config=request.param, pairs=COMMANDED).controller()


def test_a_controller_in_a_diagram_answers_every_target_as_a_served_one(controller: Controller) -> None:
    targets, period_ns = motion().targets, 200 * MS
    builder = DiagramBuilder()
    source = builder.AddSystem(TargetSource(targets, [period_ns] * len(targets)))
    system = builder.AddSystem(ControllerSystem(controller, period_ns=period_ns))
    builder.Connect(source.GetOutputPort("hand_targets"), system.GetInputPort("hand_targets"))
    log = LogVectorOutput(system.GetOutputPort("joint_commands"), builder, 0.1)
    simulator = Simulator(builder.Build())
    simulator.AdvanceTo(0.75)
    answers = predicted_joints(controller.learner(), targets.reshape(len(targets), -1), N)
    commands = log.FindLog(simulator.get_context()).data().T
    np.testing.assert_array_equal(commands, np.repeat(np.clip(answers, ROBOT.lower, ROBOT.upper), 2, axis=0))


def test_the_state_of_a_controller_is_in_the_context(controller: Controller) -> None:
    """A context that is set back answers again as it did, whatever the system did meanwhile."""
    system = ControllerSystem(controller, period_ns=200 * MS)
    simulator = Simulator(system)
    context = simulator.get_mutable_context()
    port, targets = system.GetInputPort("hand_targets"), motion().targets.reshape(4, -1)
    port.FixValue(context, targets[0])
    simulator.AdvanceTo(0.3)
    kept = context.Clone()
    answers = []
    for again in (context, kept):
        port.FixValue(again, targets[1])
        simulator.reset_context(again)
        simulator.AdvanceTo(0.5)
        answers.append(system.GetOutputPort("joint_commands").Eval(again))
    np.testing.assert_array_equal(*answers)


def test_a_teacher_begins_where_the_joints_are_measured_unless_it_is_given_a_start() -> None:
    teacher, targets = Teacher(Kinematics(ROBOT)), ROBOT.centres + 0.02
    measured, start = ROBOT.comfort + 0.01, ROBOT.comfort - 0.01
    for given, begun in ((None, measured), (start, start)):
        system = TeacherSystem(ROBOT, teacher, start=given)
        context = system.CreateDefaultContext()
        system.GetInputPort("hand_targets").FixValue(context, targets.ravel())
        system.GetInputPort("measured_joints").FixValue(context, measured)
        command = system.GetOutputPort("joint_commands").Eval(context)
        np.testing.assert_array_equal(command, teacher.step(begun, targets))


def test_a_motor_beyond_its_limit_is_an_error() -> None:
    builder = DiagramBuilder()
    robot = RobotSystem(ROBOT)
    builder.AddSystem(robot)
    command = builder.AddSystem(ConstantVectorSource(ROBOT.upper))
    builder.Connect(command.get_output_port(), robot.GetInputPort("joint_commands"))
    simulator = Simulator(builder.Build())
    robot.set_posture(simulator.get_mutable_context(), ROBOT.comfort)
    with pytest.raises(RobotError, match=r"motor of joint .* would exert"):
        simulator.AdvanceTo(0.5)


@pytest.mark.parametrize(("targets", "durations_ns"), [([], []), ([[[0.0] * 3]], [0]), ([[[0.0] * 3]], [1, 1])])
def test_targets_need_durations(targets: list[Any], durations_ns: list[int]) -> None:
    with pytest.raises(ConfigError, match="as many durations"):
        TargetSource(targets, durations_ns)
