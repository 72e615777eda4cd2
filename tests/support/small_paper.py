"""A small rerun of the paper: two networks of two epochs on 20 samples, and no simulator; its numbers mean nothing."""

from pathlib import Path

import numpy as np
from episodes import write_episode

from pipeline.deployment.deploy import Deployment, DriveResult
from pipeline.evaluation.errors import HandErrors
from pipeline.evaluation.trials import evaluate_samples
from pipeline.learner.rules.reservoir.config import LearnerConfig
from pipeline.paper.command_costs import command_costs
from pipeline.paper.comparison.error_parts import ErrorPart
from pipeline.paper.comparison.explorations import EXPLORATIONS, OTHER_ROBOTS, Explored
from pipeline.paper.comparison.results import Babbled, Comparison
from pipeline.paper.comparison.rules import OUR_RULE, PAPERS_RULE, ComparedRule, StepCosts
from pipeline.paper.comparison.teachers import TeacherTrial
from pipeline.paper.results import PATTERN_1, PATTERN_2, NetworkEnsemble, PaperResults
from pipeline.samples.pairs import Samples, read_samples
from pipeline.training.batch import Outcome, Run, compute
from replay.sources.schedule import Schedule

DRAWINGS = ("first_drawing", "second_<drawing>")
SEEDS = (4, 5)
EPOCHS = 2


def small_paper(folder: Path) -> PaperResults:
    """Make a rerun in which every motion is the beginning of the circles."""
    log = write_episode(folder / "log.mcap", samples=20)
    outcomes = [compute(Run((log,), Schedule(epochs=EPOCHS), LearnerConfig(seed=seed))) for seed in SEEDS]
    samples = read_samples(log)
    networks = {pattern: _networks(pattern, outcomes, samples) for pattern in (PATTERN_1, PATTERN_2)}
    trial = networks[PATTERN_1].trials[PATTERN_1][0]
    driven = DriveResult(trial.joints, trial.reached, trial.errors)
    return PaperResults(
        seed=SEEDS[0],
        robot=samples.robot,
        networks=networks,
        demonstrations=DRAWINGS,
        deployed=Deployment(PATTERN_2, 0.1, trial.targets, driven, driven),
        costs=command_costs(outcomes[0].controller, trial, period_ns=200_000_000),
        seconds_explore_and_learn=1.5,
        comparison=small_comparison(log),
    )


def small_comparison(log: Path) -> Comparison:
    """Make a comparison of numbers that keep every bound; scikit-learn is not installed there, and one robot not."""
    explored = tuple(
        Explored(one, seed, log, {name: _errors(0.01 * seed) for name in one.motions}, 2.5)
        for one in (*EXPLORATIONS, OTHER_ROBOTS[0])
        for seed in (1, 2)
    )
    errors = explored[0].errors, explored[1].errors
    rules = tuple(ComparedRule(name, errors, 5.0, 1.5) for name in (PAPERS_RULE, "linear ridge", OUR_RULE))
    names = ("papers_rule", "held", "reached", "reached_held", "covered", "covered_held", "linear", "linear_reached")
    parts = tuple(ErrorPart(name, f"{name} & more", errors) for name in names)
    missing = ComparedRule("scikit-learn's MLP", ())
    babbled = tuple(Babbled(one, ({name: _errors(1.5) for name in one.motions},) * 2) for one in EXPLORATIONS[2:])
    return Comparison(
        (1, 2),
        explored,
        OTHER_ROBOTS[1:2],
        (*rules, missing),
        parts,
        StepCosts(30.0, 5.0, 3.7),
        babbled,
        (
            TeacherTrial("rates", "right_hand_drawing", 2.5, 0.25, 0.3, 0.02, 5.85, 41.0),
            TeacherTrial("qp", "right_hand_drawing", 2.25, 0.125, 0.6, 0.03, None, 806.0),
        ),
    )


def _errors(cm: float) -> HandErrors:
    return HandErrors(cm, cm, {"left": cm, "right": cm}, {"left": cm, "right": cm}, 20)


def _networks(pattern: str, outcomes: list[Outcome], samples: Samples) -> NetworkEnsemble:
    names = (PATTERN_1, PATTERN_2, *DRAWINGS)
    trials = {name: tuple(evaluate_samples(one.controller, samples, name=name) for one in outcomes) for name in names}
    return NetworkEnsemble(
        pattern=pattern,
        seeds=SEEDS,
        curves_cm=np.array([one.errors_cm for one in outcomes]),
        controllers=tuple(one.controller for one in outcomes),
        trials=trials,
        linear=dict.fromkeys(names, HandErrors(0.5, 1.0, {"left": 0.4, "right": 0.6}, {"left": 0.9, "right": 1.0}, 20)),
        from_recorded_cm=np.full(len(SEEDS), 3.0),
    )
