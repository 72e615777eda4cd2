"""The learned controller beside today's inverse kinematics on the same targets: python tests/benchmarks/bench_ik.py.

All follow pattern 1 in one run, by kinematics alone: what is compared is the posture that each gives for a target, not
what a robot makes of it. The learned controller answers a target in one step. The others work with velocities and go
on from their own last posture; each is shown with the 40 steps of 5 ms that a target of the exploration holds, and with
one step of the whole 200 ms. Teacher: ours. Pink: two frame tasks of gain 1 and a weak posture task, solved by daqp.
Drake: `DoDifferentialInverseKinematics`, asked to be there within the step and drawn to the comfort posture. Limits of
position and speed are the URDF's. Repetitions are interleaved, so that a slow moment of the machine hits all. Nothing
is asserted.

Give a controller to use it instead of one that is explored and learned here (under a minute).
"""

import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pink
import pinocchio
from pydrake.multibody.inverse_kinematics import (
    DifferentialInverseKinematicsParameters,
    DifferentialInverseKinematicsStatus,
    DoDifferentialInverseKinematics,
)
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import JacobianWrtVariable

from pipeline.evaluation.errors import WASHOUT_STEPS
from pipeline.exploration.explore import explore
from pipeline.learner.controller import Controller
from pipeline.learner.rules.reservoir.config import LearnerConfig
from pipeline.motions.patterns.circles import circles
from pipeline.robot.config import RobotConfig, load_robot
from pipeline.robot.kinematics import Kinematics
from pipeline.teacher.teacher import Teacher
from pipeline.training.trainer import train
from pipeline.urdf.description import canonical_urdf
from replay.sources.schedule import Schedule

HOLD_S = 0.2
STEP_S = 0.005
REPETITIONS = 3
POSTURE_COST = 1e-3  # of Pink's posture task; the hands' tasks cost 1

Step = Callable[[np.ndarray], np.ndarray]
"""Takes the targets of both hands (2, 3), returns the next posture (n,)."""


@dataclass(frozen=True)
class Subject:
    name: str
    start: Callable[[], Step]
    steps: int


def learned(controller: Controller) -> Callable[[], Step]:
    def start() -> Step:
        learner = controller.learner()
        learner.washout(circles(load_robot("asimo")).targets[0].ravel(), steps=WASHOUT_STEPS)
        return lambda target: learner.predict(target.reshape(1, 6))[0, 6:]

    return start


def teachers(robot: RobotConfig, period_s: float) -> Callable[[], Step]:
    def start() -> Step:
        teacher, posture = Teacher(Kinematics(robot)), [robot.comfort]

        def step(target: np.ndarray) -> np.ndarray:
            posture[0] = teacher.step_for(posture[0], target, period_s)
            return posture[0]

        return step

    return start


def pinks(robot: RobotConfig, period_s: float) -> Callable[[], Step]:
    model = pinocchio.buildModelFromXML(canonical_urdf(robot.urdf_text))
    places = [model.joints[model.getJointId(name)].idx_q for name in robot.joints]

    def start() -> Step:
        q = pinocchio.neutral(model)
        q[places] = robot.comfort
        configuration = pink.Configuration(model, model.createData(), q)
        hands = [
            pink.tasks.FrameTask(name, position_cost=1.0, orientation_cost=0.0)
            for name in (hand.link for hand in robot.hands)
        ]
        posture = pink.tasks.PostureTask(cost=POSTURE_COST)
        posture.set_target(q)

        def step(target: np.ndarray) -> np.ndarray:
            for task, position in zip(hands, target, strict=True):
                task.set_target(pinocchio.SE3(np.eye(3), position))
            velocity = pink.solve_ik(configuration, [*hands, posture], period_s, solver="daqp")
            configuration.integrate_inplace(velocity, period_s)
            return configuration.q[places]

        return step

    return start


def drakes(robot: RobotConfig, period_s: float) -> Callable[[], Step]:
    plant = MultibodyPlant(time_step=0.0)
    Parser(plant).AddModelsFromString(canonical_urdf(robot.urdf_text), "urdf")
    plant.Finalize()
    places = [plant.GetJointByName(name).position_start() for name in robot.joints]
    bodies = [plant.GetBodyByName(name) for name in (hand.link for hand in robot.hands)]
    world, with_respect_to = plant.world_frame(), JacobianWrtVariable.kV
    lower, upper = plant.GetPositionLowerLimits(), plant.GetPositionUpperLimits()
    fastest = plant.GetVelocityUpperLimits()

    def start() -> Step:
        context, q = plant.CreateDefaultContext(), np.zeros(plant.num_positions())
        q[places] = robot.comfort
        parameters = DifferentialInverseKinematicsParameters(len(q), len(q))
        parameters.set_time_step(period_s)
        parameters.set_nominal_joint_position(q.copy())
        parameters.set_joint_centering_gain(np.eye(len(q)))
        parameters.set_joint_position_limits((lower, upper))
        parameters.set_joint_velocity_limits((-fastest, fastest))  # type: ignore[misc]
        still = np.zeros(len(q))

        def step(target: np.ndarray) -> np.ndarray:
            plant.SetPositions(context, q)
            jacobian = np.concatenate(
                [
                    plant.CalcJacobianTranslationalVelocity(
                        context, with_respect_to, body.body_frame(), np.zeros(3), world, world
                    )
                    for body in bodies
                ]
            )
            hands = np.array([plant.EvalBodyPoseInWorld(context, body).translation() for body in bodies])
            speed = (target - hands).ravel() / period_s
            result = DoDifferentialInverseKinematics(q, still, speed, jacobian, parameters)
            if result.status != DifferentialInverseKinematicsStatus.kNoSolutionFound:
                q[:] += period_s * result.joint_velocities
            return q[places]

        return step

    return start


def follow(subject: Subject, targets: np.ndarray) -> tuple[np.ndarray, float]:
    """Return the posture at the end of each hold (T, n), and the time of a step [us]."""
    step = subject.start()
    for _ in range(subject.steps):
        step(targets[0])  # to the first target, before the clock runs
    postures = []
    began = time.perf_counter()
    for target in targets:
        for _ in range(subject.steps):
            posture = step(target)
        postures.append(posture.copy())
    return np.array(postures), (time.perf_counter() - began) / (len(targets) * subject.steps) * 1e6


def learn(robot: RobotConfig) -> Controller:
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "circles.mcap"
        explore(robot, circles(robot), seed=0, out=log)
        return train([log], schedule=Schedule(epochs=150), config=LearnerConfig(seed=0)).controller()


def main() -> None:
    robot = load_robot("asimo")
    controller = Controller.load(sys.argv[1]) if sys.argv[1:] else learn(robot)
    subjects = [Subject("learned", learned(controller), 1)]
    for name, make in (("teacher", teachers), ("pink, daqp", pinks), ("Drake DiffIK", drakes)):
        for period_s in (STEP_S, HOLD_S):
            subjects.append(Subject(name, make(robot, period_s), round(HOLD_S / period_s)))
    targets, kinematics = circles(robot).targets, Kinematics(robot)
    times: dict[int, list[float]] = {place: [] for place in range(len(subjects))}
    errors_cm: dict[int, float] = {}
    for _ in range(REPETITIONS):
        for place, subject in enumerate(subjects):
            postures, microseconds = follow(subject, targets)
            times[place].append(microseconds)
            misses = np.linalg.norm(kinematics.hands_along(postures) - targets, axis=2)
            errors_cm[place] = 100.0 * float(misses.mean())
    print(f"pattern 1, {len(targets)} targets held for {HOLD_S} s, kinematics alone")
    print(f"{'':14s}{'steps':>6s}{'error cm':>10s}{'us a step':>11s}{'us a target':>13s}")
    for place, subject in enumerate(subjects):
        us = statistics.median(times[place])
        print(f"{subject.name:14s}{subject.steps:6d}{errors_cm[place]:10.3f}{us:11.1f}{us * subject.steps:13.1f}")


if __name__ == "__main__":
    main()
