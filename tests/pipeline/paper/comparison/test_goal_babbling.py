"""Goal babbling: what is learned reaches better the longer it is tried, from a seed, with a map that begins as home."""

import numpy as np
import pytest

from pipeline.paper.comparison.goal_babbling import LocalLinearMap, goal_babbling
from pipeline.paper.comparison.rules import errors_of, motions_of
from pipeline.robot.config import load_robot

ASIMO = load_robot("asimo")


def error_cm(duration_s: float) -> float:
    """Mean error [cm] on the circles after so long a time of the robot."""
    answer = goal_babbling(ASIMO, seed=0, duration_s=duration_s)
    return errors_of(ASIMO, answer, motions_of(ASIMO, ["circles"]))["circles"].mean_cm


def test_it_learns_to_reach_by_trying_to() -> None:
    at_first_cm, later_cm = error_cm(0.04), error_cm(30.0)
    assert at_first_cm > 10.0
    assert later_cm < 0.5 * at_first_cm


def test_a_seed_names_what_is_learned() -> None:
    targets = ASIMO.input_centre + 0.05 * np.eye(6)
    one, again, other = (goal_babbling(ASIMO, seed=seed, duration_s=2.0)(targets) for seed in (1, 1, 2))
    assert np.array_equal(one, again)
    assert not np.array_equal(one, other)
    assert (one >= ASIMO.lower).all()
    assert (one <= ASIMO.upper).all()


def test_the_map_begins_as_a_constant_and_a_new_model_is_its_tangent() -> None:
    learned = LocalLinearMap(np.zeros(2), np.array([1.0]), radius=1.0, rate=0.1)
    assert learned(np.array([5.0, -5.0])) == pytest.approx([1.0])
    learned.learn(np.array([0.5, 0.0]), np.array([2.0]), 1.0)
    far = np.array([1.2, 0.0])
    before = learned(far)
    learned.learn(far, np.array([7.0]), 0.0)  # begins a model, and learns nothing
    assert learned(far) == pytest.approx(before, abs=1e-6)
    step = np.array([0.01, 0.0])
    slope = (learned(far + step) - learned(far - step)) / 0.02
    assert slope == pytest.approx([0.05], abs=0.01)


def test_the_map_learns_a_linear_function() -> None:
    learned = LocalLinearMap(np.zeros(2), np.zeros(2), radius=1.0, rate=0.3)
    turn = np.array([[0.5, -1.0], [1.0, 0.5]])
    for x in np.random.default_rng(0).uniform(-1.0, 1.0, (2000, 2)):
        learned.learn(x, turn @ x, 1.0)
    x = np.array([0.4, -0.6])
    assert learned(x) == pytest.approx(turn @ x, abs=0.05)
