"""The learned controller and the teacher are compared by kinematics alone, and the teacher's steps are a choice."""

import itertools

import numpy as np
import pytest
from episodes import write_episode

from pipeline.evaluation.errors import HandErrors, hand_errors
from pipeline.evaluation.trials import Trial, evaluate_motion, robot_of
from pipeline.learner.controller import Controller
from pipeline.learner.rules.reservoir.config import LearnerConfig
from pipeline.paper.command_costs import CommandCost, command_costs
from pipeline.robot.kinematics import Kinematics
from pipeline.teacher.teacher import Teacher
from pipeline.training.trainer import train
from replay.sources.schedule import Schedule

PERIOD_NS = 200_000_000


@pytest.fixture(scope="module")
def controller(tmp_path_factory: pytest.TempPathFactory) -> Controller:
    log = write_episode(tmp_path_factory.mktemp("costs") / "log.mcap", samples=20)
    return train([log], schedule=Schedule(epochs=1), config=LearnerConfig()).controller()


@pytest.fixture(scope="module")
def trial(controller: Controller) -> Trial:
    return evaluate_motion(controller, "eight")


@pytest.fixture(scope="module")
def costs(controller: Controller, trial: Trial) -> tuple[CommandCost, ...]:
    return command_costs(controller, trial, period_ns=PERIOD_NS)


def test_each_is_named_with_its_steps(costs: tuple[CommandCost, ...]) -> None:
    assert [(cost.name, cost.steps) for cost in costs] == [
        ("learned", 1),
        ("teacher, 5 ms a step", 40),
        ("teacher, 200 ms a step", 1),
    ]


def test_the_time_is_that_of_one_step_in_the_middle_of_all_repetitions(
    controller: Controller, trial: Trial, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By a clock that takes a second for the motion, but a minute for every third repetition."""
    rounds = itertools.cycle([60.0, 1.0, 1.0])
    ticks = itertools.accumulate(part for seconds in rounds for part in (seconds, 0.0))
    monkeypatch.setattr("pipeline.paper.command_costs.time.perf_counter", itertools.chain([0.0], ticks).__next__)
    costs = command_costs(controller, trial, period_ns=PERIOD_NS)
    assert [cost.microseconds for cost in costs] == pytest.approx([1e6 / len(trial.targets)] * 3)


def test_the_learned_controllers_error_is_that_of_its_trial(costs: tuple[CommandCost, ...], trial: Trial) -> None:
    assert costs[0].mean_cm == trial.errors.mean_cm


@pytest.mark.parametrize("place", [1, 2])
def test_the_teachers_error_is_that_of_its_posture_after_all_steps(
    controller: Controller, trial: Trial, costs: tuple[CommandCost, ...], place: int
) -> None:
    cost, kinematics = costs[place], Kinematics(robot_of(controller))
    teacher, q, postures = Teacher(kinematics), robot_of(controller).comfort, []
    for target in (trial.targets[0], *trial.targets):
        for _ in range(cost.steps):
            q = teacher.step_for(q, target.reshape(2, 3), 0.2 / cost.steps)
        postures.append(q)
    errors = hand_errors(kinematics, np.array(postures[1:]), trial.targets)
    assert cost.mean_cm == pytest.approx(HandErrors.of(errors, ("left", "right")).mean_cm, rel=1e-9)
