"""The kernels of `forward-inverse` on a robot that is small enough to be worked out beside them in plain numpy."""

import importlib.util
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pipeline.learner.body import Body
from pipeline.learner.rules.forward_inverse import kernels
from pipeline.learner.rules.forward_inverse.config import ForwardInverseConfig
from pipeline.learner.rules.forward_inverse.learner import ForwardInverseLearner
from recorders.errors import ConfigError, MessageError

_spec = importlib.util.spec_from_file_location("plain", Path(__file__).with_name("plain_forward_inverse.py"))
plain = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(plain)

BODY = Body(
    hands=("left", "right"),
    joints=("a", "b", "c"),
    lower=(-1.5, -0.5, -2.0),
    upper=(1.0, 2.0, 2.0),
    moves=((0, 1), (0, 1, 2)),
    reach=(0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 1.1, 1.2, 1.3),
    poses=("right",),
)
CENTRE = {
    "input_centre": np.linspace(-0.2, 0.2, 9),
    "output_centre": np.array([*np.linspace(-0.2, 0.2, 9), 0.1, 0.2, -0.3]),
}


def both(*, body=BODY, **settings):
    """The rule and the same in plain numpy."""
    config = ForwardInverseConfig(**{"degree": 2, "prior": 1e-2, "damping": 1e-2, **settings}).with_body(body)
    return ForwardInverseLearner(config, **CENTRE), plain.PlainForwardInverse(config, **CENTRE)


def samples(count, *, seed=0):
    """Joints within their limits, and hands that follow from them."""
    generator = np.random.default_rng(seed)
    q = generator.uniform(BODY.lower, BODY.upper, (count, 3))
    mix = generator.uniform(-0.4, 0.4, (3, 9))
    mix[2, :3] = 0.0
    u = CENTRE["input_centre"] + np.sin(q @ mix) + 0.02 * generator.standard_normal((count, 9))
    return u, np.concatenate([u, q], axis=1)


def assert_same(learner, expected):
    state = learner.state()
    for name, model in expected.models().items():
        upper = np.triu_indices(len(model.covariance))
        for part, found in {"covariance": model.covariance[upper], "weights": model.weights}.items():
            np.testing.assert_allclose(state[f"{name}_{part}"], found, rtol=1e-7, atol=1e-9, err_msg=f"{name} {part}")
        np.testing.assert_allclose(state[f"{name}_errors"], model.errors, rtol=1e-7, atol=1e-13, err_msg=name)
        np.testing.assert_allclose(state[f"{name}_leverage"], model.leverage, rtol=1e-7, atol=1e-13, err_msg=name)


@pytest.mark.parametrize(
    "settings",
    [
        {},
        {"degree": 3, "forgetting": 0.97},
        {"forgetting": 0.9, "residual_degree": 1, "residual_forgetting": 0.95, "residual_prior": 0.3},
    ],
)
def test_every_step_is_that_of_plain_numpy(settings) -> None:
    learner, expected = both(**settings)
    u, d = samples(12 if learner.config.degree == 3 else 24)
    for k in range(len(u)):
        outputs = learner.step(u[k : k + 1], d[k : k + 1], learning=k % 5 != 4)
        np.testing.assert_allclose(outputs[0], expected.step(u[k], d[k], learning=k % 5 != 4), rtol=0, atol=1e-9)
    assert_same(learner, expected)
    for k in range(8):  # far away, where joints reach their limits
        far = CENTRE["input_centre"] + 3.0 * (u[k] - CENTRE["input_centre"])
        outputs = learner.predict(far[np.newaxis])[0]
        np.testing.assert_allclose(outputs, expected.step(far, d[k], learning=False), rtol=0, atol=1e-8)
        assert np.all(outputs[9:] >= BODY.lower)
        assert np.all(outputs[9:] <= BODY.upper)
    assert_same(learner, expected)


def test_what_is_held_is_learned_until_it_brings_less_than_twice_what_is_forgotten() -> None:
    learner, expected = both(degree=1, forgetting=0.9)
    u, d = samples(3)
    for k in [0] * 8 + [1] * 8 + [2, 0, 1, 2]:
        learner.step(u[k : k + 1], d[k : k + 1], learning=True)
        expected.step(u[k], d[k], learning=True)
    assert_same(learner, expected)


@pytest.mark.parametrize(
    ("variance", "forgetting", "learns"), [(1.0, 0.5, True), (0.999, 0.5, False), (1e-9, 1.0, True), (0.0, 1.0, False)]
)
def test_a_sample_that_brings_nothing_new_is_passed_over(variance: float, forgetting: float, learns: bool) -> None:
    learner, _ = both(degree=1)
    inverse = kernels.model_views(learner._sizes, learner._tables, learner._memory, 0)
    inverse.features[:] = np.eye(10)[0]
    inverse.covariance[:] = np.diag([variance, *[1.0] * 9])
    kernels.learn(inverse, np.ones(3), 1e-2, forgetting)
    assert bool(inverse.weights.any()) == bool(inverse.errors.any()) == bool(inverse.leverage.any()) == learns


def test_without_forgetting_a_prior_limits_no_variance() -> None:
    learner, _ = both(degree=1)
    inverse = kernels.model_views(learner._sizes, learner._tables, learner._memory, 0)
    inverse.features[:] = np.eye(10)[0]
    inverse.covariance[:] = np.eye(10)
    kernels.learn(inverse, np.ones(3), 1e3, 1.0)
    np.testing.assert_array_equal(inverse.covariance, np.diag([0.5, *[1.0] * 9]))


def test_what_is_left_in_the_scratch_changes_nothing() -> None:
    """Commands, learning and derivatives are those of a learner whose scratch is as it was made."""
    body = replace(
        BODY, poses=("left",)
    )  # whose hand has more rows than there are joints, one of which does not move it
    learner, littered = (both(body=body, residual_degree=1)[0] for _ in range(2))
    u, d = samples(6)
    for k in range(5):
        common = kernels.common_views(littered._sizes, littered._memory)
        scratch = [common.target, common.aim, common.posture, common.estimate, common.hands]
        scratch += [common.jacobian, common.square, common.solution]
        for place in range(4):
            model = kernels.model_views(littered._sizes, littered._tables, littered._memory, place)
            scratch += [model.powers, model.features, model.gain, model.spare, model.found]
        for array in scratch:
            array[...] = 7.0
        found = [part.step(u[k : k + 1], d[k : k + 1], learning=True) for part in (learner, littered)]
        np.testing.assert_array_equal(*found)
        common.jacobian[...] = 7.0
        for here, there in zip(learner.linearise(d[k, 9:]), littered.linearise(d[k, 9:]), strict=True):
            np.testing.assert_array_equal(here, there)
    states = learner.state(), littered.state()
    assert all(np.array_equal(states[1][name], values) for name, values in states[0].items())


@pytest.mark.parametrize("count", [0, 1, 12])
def test_a_command_is_explained_by_where_the_hands_are_expected(count: int) -> None:
    """At the joints of the command, with what the residual adds at the target."""
    learner, expected = both(residual_degree=1)
    u, d = samples(count + 2)
    for k in range(count):
        learner.step(u[k : k + 1], d[k : k + 1], learning=True)
        expected.step(u[k], d[k], learning=True)
    explained = learner.explain(u[count:])
    for row, target in enumerate((u[count:] - expected.centre) / expected.reach):
        joints = expected.step(u[count + row], d[count + row], learning=False)[9:]
        np.testing.assert_allclose(explained.joints[row], joints, rtol=0, atol=1e-9)
        estimate = expected.limited(expected.inverse.outputs(expected.aim(target)))
        np.testing.assert_allclose(explained.estimate[row], expected.comfort + expected.half * estimate, atol=1e-9)
        hands = expected.hands((joints - expected.comfort) / expected.half) + target - expected.aim(target)
        np.testing.assert_allclose(explained.hands[row], expected.centre + expected.reach * hands, atol=1e-9)


def test_limits_are_reached_on_both_sides() -> None:
    learner, _ = both()
    u, d = samples(24)
    learner.step(u, d, learning=True)
    joints = learner.predict(CENTRE["input_centre"] + 5.0 * (u - CENTRE["input_centre"]))[:, 9:]
    np.testing.assert_allclose(joints.min(axis=0), BODY.lower, rtol=0, atol=1e-14)
    np.testing.assert_allclose(joints.max(axis=0), BODY.upper, rtol=0, atol=1e-14)


@pytest.mark.parametrize("forgetting", [1.0, 0.9])
@pytest.mark.parametrize("count", [0, 1, 2, 5, 24])
def test_deviations_and_derivatives_are_those_of_plain_numpy(count: int, forgetting: float) -> None:
    learner, expected = both(forgetting=forgetting)
    u, d = samples(count + 4, seed=count)  # more than there are joints
    for k in range(count):
        learner.step(u[k : k + 1], d[k : k + 1], learning=True)
        expected.step(u[k], d[k], learning=True)
    outputs = learner.predict(u[count:])
    deviations = learner.deviations(u[count:])
    for row, joints in enumerate(outputs[:, 9:]):
        posture = (joints - expected.comfort) / expected.half
        units = np.split(expected.reach, expected.ends[:-1])
        found = [
            model.deviation(posture * expected.half, unit) for model, unit in zip(expected.forward, units, strict=True)
        ]
        np.testing.assert_allclose(deviations[row], found, rtol=1e-6)
        hands, jacobian = learner.linearise(joints)
        np.testing.assert_allclose(hands, expected.centre + expected.reach * expected.hands(posture), atol=1e-9)
        scale = expected.reach[:, np.newaxis] / expected.half
        np.testing.assert_allclose(jacobian, expected.jacobian(posture) * scale, atol=1e-8)


def fitted(squares, leverages, weights):
    """a and b of the line that is fitted to squared errors over leverage."""
    learner, _ = both(degree=1)
    model = kernels.model_views(learner._sizes, learner._tables, learner._memory, 1)
    squares, x, w = (np.array(values, dtype=float) for values in (squares, leverages, weights))
    model.leverage[:3] = np.array([1.0, 2.0, 4.0]) * (w @ squares) / 7.0
    model.leverage[3:6] = np.array([4.0, 1.0, 2.0]) * (w @ (x * squares)) / 7.0
    model.leverage[6:] = w.sum(), w @ x, w @ (x * x), len(w)
    return kernels.fit_errors(model, np.ones(3))


def test_the_line_of_errors_over_leverage_is_a_least_squares_line_that_falls_nowhere_below_zero() -> None:
    assert fitted([3.0, 5.0, 9.0], [0.0, 1.0, 3.0], [1.0, 2.0, 1.0]) == pytest.approx((3.0, 2.0))
    assert fitted([9.0, 5.0], [0.0, 2.0], [1.0, 3.0]) == pytest.approx((6.0, 0.0))  # it would fall: the mean
    x, squares, w = np.array([1.0, 3.0]), np.array([1.0, 9.0]), np.array([2.0, 1.0])
    through_zero = (w @ (x * squares)) / (w @ (x * x))
    assert fitted(squares, x, w) == pytest.approx((0.0, through_zero))  # it would begin below zero: through zero
    assert fitted([1.0, 3.0], [2.0, 2.0], [1.0, 1.0]) == pytest.approx((2.0, 0.0))  # one leverage: the mean
    assert fitted([1.0, 3.0], [0.0, 0.0], [1.0, 1.0]) == pytest.approx((2.0, 0.0))  # and so is one of none
    assert fitted([2.0, 4.0], [1.0, 2.0], [1.0, 1.0]) == pytest.approx((0.0, 2.0), abs=1e-12)  # both ends of the range


def test_what_is_not_finite_is_refused_and_changes_nothing() -> None:
    learner, _ = both()
    u, d = samples(3)
    learner.step(u, d, learning=True)
    before = learner.state()
    for place in ((0, 0), (2, 8)):
        bad = u.copy()
        bad[place] = np.nan
        with pytest.raises(MessageError, match="finite numbers in u"):
            learner.predict(bad)
        bad = d.copy()
        bad[place] = np.inf
        with pytest.raises(MessageError, match="finite numbers in d"):
            learner.step(u, bad, learning=True)
        arrays = learner._sizes, learner._tables, learner._memory, learner._settings, np.empty((3, 12))
        assert kernels.run(u, bad, True, *arrays) == kernels.BAD_TARGET
    assert all(np.array_equal(before[name], values) for name, values in learner.state().items())


@pytest.mark.parametrize("name", ["inverse_weights", "forward_right_weights", "residual_weights"])
def test_numbers_that_are_too_large_are_one_error(name: str) -> None:
    learner, _ = both(residual_degree=1)
    u, d = samples(3)
    state = learner.state()
    learner.load_state({**state, name: state[name] + 1e300})
    with np.errstate(all="ignore"), pytest.raises(ConfigError, match="diverged"):
        learner.step(np.repeat(u, 8, axis=0) * 1e8, np.repeat(d, 8, axis=0), learning=True)


def arrays(learner, model, part):
    memory = kernels.model_views(learner._sizes, learner._tables, learner._memory, model)
    return getattr(memory, part)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("part", ["weights", "errors", "leverage", "covariance"])
@pytest.mark.parametrize("model", [0, 1, 2, 3])
def test_a_state_that_is_not_finite_anywhere_is_seen(model: int, part: str, value: float) -> None:
    learner, _ = both(residual_degree=1, degree=1)
    sizes, tables, memory = learner._sizes, learner._tables, learner._memory
    assert kernels.is_finite(sizes, tables, memory)
    arrays(learner, model, part)[-1, ...] = value
    assert not kernels.is_finite(sizes, tables, memory)


def test_views_do_not_overlap_and_fill_the_memory() -> None:
    learner, _ = both(residual_degree=1)
    memory = learner._memory
    memory[:] = 0.0
    views = list(kernels.common_views(learner._sizes, memory))
    for place in range(4):
        model = kernels.model_views(learner._sizes, learner._tables, memory, place)
        views += [model.weights, model.covariance, model.errors, model.leverage, model.powers]
        views += [model.features, model.gain, model.spare, model.found]
    for number, view in enumerate(views, start=1):
        view += number
    assert [int((memory == number).sum()) for number in range(1, len(views) + 1)] == [view.size for view in views]
    assert sum(view.size for view in views) == memory.size


def test_views_of_the_tables_are_all_of_them_in_order() -> None:
    learner, _ = both(residual_degree=1)
    views = []
    for place in range(4):
        model = kernels.model_views(learner._sizes, learner._tables, learner._memory, place)
        assert model.parents.size == model.places.size == model.features.size
        views += [model.variables, model.parents, model.places, model.raised.reshape(-1)]
    np.testing.assert_array_equal(np.concatenate(views), learner._tables)


def test_a_matrix_is_factorised_if_it_is_positive_definite() -> None:
    square = np.array([[4.0, 9.0, 9.0], [2.0, 5.0, 9.0], [2.0, 3.0, 6.0]])  # above the diagonal nothing is read
    factor = square.copy()
    assert kernels.factorise(factor)
    values = np.array([1.0, 2.0, 3.0])
    solution = values.copy()
    kernels.solve(factor, solution)
    symmetric = np.tril(square) + np.tril(square, -1).T
    np.testing.assert_allclose(np.tril(factor), np.linalg.cholesky(symmetric), rtol=1e-12)
    np.testing.assert_allclose(symmetric @ solution, values, rtol=1e-12)
    assert not kernels.factorise(np.zeros((1, 1)))
    assert not kernels.factorise(np.array([[1.0, 0.0], [1.0, 1.0]]))
