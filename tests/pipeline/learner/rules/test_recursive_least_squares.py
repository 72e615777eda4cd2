"""Recursive least squares stay exact least squares, however long they go on; a target that is held winds nothing up.

The exact solution is worked out beside them from accumulated normal equations, by numpy's own polynomials.
"""

import math
from itertools import combinations_with_replacement

import numpy as np
import pytest
from numpy.polynomial.legendre import legval

from pipeline.learner.body import Body
from pipeline.learner.rules.forward_inverse.config import ForwardInverseConfig
from pipeline.learner.rules.forward_inverse.learner import ForwardInverseLearner

JOINTS = 3
DEGREE = 3
PRIOR = 1e-4
PIECE = 10_000
SHORT, LONG = (40_000, 5_000), (1_000_000, 100_000)  # varied steps, and steps of a held target
HELD = 10_000

BODY = Body(
    hands=("left",),
    joints=("a", "b", "c"),
    lower=(-1.0,) * JOINTS,
    upper=(1.0,) * JOINTS,
    moves=((0, 1, 2),),
    reach=(1.0,) * 3,
)
PRODUCTS = [p for total in range(DEGREE + 1) for p in combinations_with_replacement(range(JOINTS), total)]
MODELS = ("inverse", "forward_left")


def learner_of(forgetting: float) -> ForwardInverseLearner:
    priors = {"prior": PRIOR, "inverse_prior": PRIOR}
    config = ForwardInverseConfig(degree=DEGREE, forgetting=forgetting, **priors).with_body(BODY)
    return ForwardInverseLearner(config, input_centre=np.zeros(3), output_centre=np.zeros(3 + JOINTS))


def varied(count: int, generator: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Hands and joints, both within [-1, 1], with a millimetre of noise."""
    q = generator.uniform(-1.0, 1.0, (count, JOINTS))
    turned = q @ np.array([[0.8, 0.3, 0.0], [-0.3, 0.7, 0.2], [0.1, -0.2, 0.9]])
    return turned - 0.1 * turned**3 + 0.05 * q[:, [1, 2, 0]] ** 2 + 1e-3 * generator.standard_normal(q.shape), q


def features(x: np.ndarray, model: str) -> np.ndarray:
    """All products of x^k / k!, or of Legendre polynomials over k!, of three variables up to a degree of three."""
    legendre = [legval(x, np.eye(DEGREE + 1)[k]) for k in range(DEGREE + 1)]
    plain = legendre if model == "inverse" else [x**k for k in range(DEGREE + 1)]
    powers = [power / math.factorial(k) for k, power in enumerate(plain)]
    columns = [np.prod([powers[p.count(v)][:, v] for v in range(JOINTS)], axis=0) for p in PRODUCTS]
    return np.stack(columns, axis=1)


class Exact:
    """Weighted least squares of both models by normal equations."""

    def __init__(self, forgetting: float) -> None:
        self._forgetting = forgetting
        size = len(PRODUCTS)
        self.information = {model: PRIOR * np.eye(size) for model in MODELS}
        self._right = {model: np.zeros((size, 3)) for model in MODELS}

    def add(self, u: np.ndarray, q: np.ndarray) -> None:
        kept = self._forgetting ** len(u)
        weights = np.sqrt(self._forgetting ** np.arange(len(u) - 1.0, -1.0, -1.0))[:, np.newaxis]
        for model, x, y in ((MODELS[0], u, q), (MODELS[1], q, u)):
            f = features(x, model) * weights
            self.information[model] = self.information[model] * kept + f.T @ f
            self._right[model] = self._right[model] * kept + f.T @ (y * weights)

    def weights(self, model: str) -> np.ndarray:
        return np.linalg.solve(self.information[model], self._right[model])


def whole(state: dict[str, np.ndarray], model: str) -> np.ndarray:
    """The covariance of a model as a square matrix."""
    square = np.zeros((len(PRODUCTS),) * 2)
    square[np.triu_indices(len(square))] = state[f"{model}_covariance"]
    return square + np.triu(square, 1).T


def step(learner: ForwardInverseLearner, u: np.ndarray, q: np.ndarray) -> None:
    learner.step(u, np.concatenate([u, q], axis=1), learning=True)


@pytest.mark.parametrize(("steps", "held_steps"), [SHORT, pytest.param(*LONG, marks=pytest.mark.campaign)])
@pytest.mark.parametrize("forgetting", [1.0, 0.999])
def test_they_are_exact_least_squares_with_a_held_target_in_between(
    steps: int, held_steps: int, forgetting: float
) -> None:
    """Predictions within 1e-9 of the exact ones, in m and rad, and covariances within 1e-9 of the largest.

    Where samples are forgotten, those of the held target are passed over; the varied ones that follow are so many that
    nothing of what came before counts.
    """
    learner, exact, generator = learner_of(forgetting), Exact(forgetting), np.random.default_rng(5)
    for start in range(0, steps, PIECE):
        u, q = varied(PIECE, generator)
        step(learner, u, q)
        exact.add(u, q)
        if start == 0:
            held = [np.repeat(rows[:1], held_steps, axis=0) for rows in (u, q)]
            step(learner, *held)
            if forgetting == 1.0:
                exact.add(*held)
    state, (u, q) = learner.state(), varied(1000, generator)
    for model, x in zip(MODELS, (u, q), strict=True):
        f = features(x, model)
        found, expected = f @ state[f"{model}_weights"], f @ exact.weights(model)
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9)
        covariance = np.linalg.inv(exact.information[model])
        np.testing.assert_allclose(whole(state, model), covariance, rtol=0, atol=1e-9 * np.abs(covariance).max())
        assert np.linalg.eigvalsh(whole(state, model)).min() > 0.0


@pytest.mark.parametrize("forgetting", [0.9, 0.99, 0.999, 1.0])
def test_a_held_target_winds_nothing_up(forgetting: float) -> None:
    """No variance grows by more than e, none beyond its prior, and no sample counts once it brings nothing new."""
    learner, (u, q) = learner_of(forgetting), varied(5000, np.random.default_rng(6))
    step(learner, u, q)
    before = learner.state()
    step(learner, np.repeat(u[:1], HELD // 2, axis=0), np.repeat(q[:1], HELD // 2, axis=0))
    half = learner.state()
    step(learner, np.repeat(u[:1], HELD // 2, axis=0), np.repeat(q[:1], HELD // 2, axis=0))
    after = learner.state()
    for model in MODELS:
        growth = np.diag(whole(after, model)) / np.diag(whole(before, model))
        assert growth.max() < np.e
        assert np.diag(whole(after, model)).max() <= 1.0 / PRIOR
        if forgetting < 1.0:
            assert all(half[name].tobytes() == after[name].tobytes() for name in after)


@pytest.mark.parametrize("forgetting", [0.9, 0.99, 0.999])
def test_what_is_never_seen_stays_at_its_prior(forgetting: float) -> None:
    """Samples along one line say nothing of the rest, whose variance would grow without end."""
    learner, generator = learner_of(forgetting), np.random.default_rng(7)
    line = generator.uniform(-1.0, 1.0, (20_000, 1)) * np.array([1.0, 0.5, -0.5])
    step(learner, line, line)
    for model in MODELS:
        covariance = whole(learner.state(), model)
        assert np.diag(covariance).max() <= (1.0 + 1e-12) / PRIOR
        assert np.diag(covariance).min() >= 0.0
    u, q = varied(20_000, generator)
    step(learner, u, q)
    assert np.linalg.norm(learner.predict(u[-500:])[:, 3:] - q[-500:], axis=1).mean() < 0.01


def test_weights_follow_a_world_that_changes_where_samples_are_forgotten() -> None:
    u, q = varied(20_000, np.random.default_rng(8))
    learners = {forgetting: learner_of(forgetting) for forgetting in (1.0, 0.99)}
    errors = {}
    for forgetting, learner in learners.items():
        step(learner, u, q)
        step(learner, u[:2000] + 0.1, q[:2000])
        f = features(q[:500], "forward_left")
        errors[forgetting] = np.abs(f @ learner.state()["forward_left_weights"] - (u[:500] + 0.1)).mean()
    assert errors[0.99] < 0.2 * errors[1.0]
