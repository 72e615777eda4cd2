"""The kernels of `reservoir` on a network of a few neurons, beside the same in plain numpy, and what they refuse."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import ArrayLike

from pipeline.learner.rules.reservoir import kernels
from pipeline.learner.rules.reservoir.config import LearnerConfig
from pipeline.learner.rules.reservoir.learner import Learner
from recorders.errors import ConfigError, MessageError

_spec = importlib.util.spec_from_file_location("reference", Path(__file__).with_name("reference_learner.py"))
reference = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(reference)

CENTRE = {"input_centre": np.array([0.2, 0.5]), "output_centre": np.array([0.2, 0.5, -0.4])}
DENSE = {
    f"{kind}_density": 0.7
    for kind in ("input_reservoir", "reservoir_reservoir", "reservoir_output", "output_reservoir", "input_output")
}
APART = np.array([1.0, 2.0])
RATES = {"bpdc_rate_start": 0.15, "bpdc_rate_end": 0.15, "ip_rate_start": 0.015, "ip_rate_end": 0.015}


def small(*, feedback: float = 0.5, reservoir: int = 5, **changes: float) -> Learner:
    settings = {**DENSE, **RATES, "output_output_density": feedback, "inputs": 2, "outputs": 3, "seed": 3, **changes}
    return Learner(LearnerConfig(reservoir=reservoir, **settings), **CENTRE)


def motion(steps: int) -> tuple[np.ndarray, np.ndarray]:
    phase = np.arange(steps)[:, np.newaxis] * 0.4
    u = CENTRE["input_centre"] + 0.3 * np.sin(phase * [1, 2])
    return u, CENTRE["output_centre"] + 0.4 * np.cos(phase * [1, 2, 3])


@pytest.mark.parametrize("reservoir", [1, 5])
@pytest.mark.parametrize("feedback", [0.0, 0.5, 1.0])
def test_every_step_is_that_of_plain_numpy(feedback: float, reservoir: int) -> None:
    learner = small(feedback=feedback, reservoir=reservoir)
    plain = reference.ReferenceLearner(learner)
    u, d = motion(12)
    for k in range(len(u)):
        learning = k % 4 != 3
        outputs = learner.step(u[k : k + 1], d[k : k + 1], learning=learning)
        row = u[k] - learner.input_centre, d[k] - learner.output_centre
        x = plain.step(*row, eta=0.15, zeta=0.015, learning=learning)
        np.testing.assert_allclose(outputs[0] - learner.output_centre, x, rtol=0, atol=1e-13)
    state = learner.state()
    for name, found in {"a": plain.a, "b": plain.b, "x": plain.x, "y": plain.y, "e": plain.e}.items():
        np.testing.assert_allclose(state[name], found, rtol=1e-12, atol=1e-13, err_msg=name)
    for name, first in (("reservoir_output", plain.outputs), ("output_output", 0)):
        targets, sources = learner.connections(name)
        np.testing.assert_allclose(state[f"{name}_weights"], plain.w_net[targets, first + sources], atol=1e-13)
    targets, sources = learner.connections("input_output")
    np.testing.assert_allclose(state["input_output_weights"], plain.w_in[targets, sources], atol=1e-13)


def look(learner: Learner, u: np.ndarray, low: ArrayLike, high: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Look ahead; return the outputs and the last two of them, within limits."""
    outputs, limited = np.empty(3), np.empty(2)
    limits = np.array([np.broadcast_to(low, 2), np.broadcast_to(high, 2)], dtype=float)
    learner.look_ahead(u, limits=limits, outputs=outputs, limited=limited)
    return outputs, limited


@pytest.mark.parametrize("settings", [{}, {"reservoir": 30, "reservoir_reservoir_density": 0.1}])
def test_a_look_ahead_and_its_step_are_a_prediction_to_the_bit(settings: dict[str, float]) -> None:
    ahead, plain = small(**settings), small(**settings)
    for learner in (ahead, plain):
        learner.step(*motion(5), learning=True)
    for u in motion(4)[0]:
        expected = plain.predict(u[np.newaxis])[0]
        outputs, limited = look(ahead, u, -9.0, 9.0)
        assert np.array_equal(outputs, expected)
        assert limited.tolist() == expected[1:].tolist()
        above, below = expected[1:] + APART, expected[1:] - APART
        assert look(ahead, u, above, 9.0)[1].tolist() == above.tolist()
        assert look(ahead, u, -9.0, below)[1].tolist() == below.tolist()
        ahead.advance()
        state = plain.state()
        assert all(np.array_equal(values, state[name]) for name, values in ahead.state().items())


def status(
    learner: Learner, *, u: int = 2, limits: tuple[int, int] = (2, 1), outputs: int = 3, limited: int = 1
) -> int:
    """Return the status of a look ahead with arrays of these sizes."""
    call = learner.bind_look_ahead(
        np.zeros(u), limits=np.zeros(limits), outputs=np.empty(outputs), limited=np.empty(limited)
    )
    return call()


def test_arrays_of_other_sizes_are_refused() -> None:
    learner = small()
    assert status(learner) == kernels.OK
    assert status(learner, limits=(2, 3), limited=3) == kernels.OK
    for sizes in (
        {"u": 3},
        {"u": 1},
        {"outputs": 4},
        {"outputs": 2},
        {"limits": (2, 2)},
        {"limits": (1, 1)},
        {"limits": (2, 4), "limited": 4},
    ):
        assert status(learner, **sizes) == kernels.BAD_SHAPE, sizes
    with pytest.raises(MessageError, match="sizes of the network"):
        learner.check(kernels.BAD_SHAPE)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_what_is_not_finite_is_refused_and_changes_nothing(value: float) -> None:
    learner = small()
    u, d = motion(3)
    learner.step(u, d, learning=True)
    before = learner.state()
    bad_u, bad_d = u.copy(), d.copy()
    bad_u[2, 1] = bad_d[2, 2] = value
    for rows, targets, name in ((bad_u, d, "u"), (u, bad_d, "d"), (bad_u, bad_d, "u")):
        with pytest.raises(MessageError, match=f"finite numbers in {name},"):
            learner.step(rows, targets, learning=True)
    with pytest.raises(MessageError, match="finite numbers in u,"):
        look(learner, bad_u[2], 0.0, 1.0)
    assert all(np.array_equal(before[name], values) for name, values in learner.state().items())


@pytest.mark.parametrize("name", ["a", "b", "output_weights"])
def test_a_state_that_is_not_finite_is_one_error(name: str) -> None:
    learner = small()
    learner.step(*motion(3), learning=True)
    network = learner._network
    getattr(kernels.views(network.sizes, network.memory), name)[-1, ...] = np.nan
    with pytest.raises(ConfigError, match="diverged"):
        learner.step(*motion(1), learning=True)


def test_activations_that_are_not_finite_are_one_error() -> None:
    learner = small()
    views = kernels.views(learner._network.sizes, learner._network.memory)
    views.reservoir_weights[-1] = np.nan
    with pytest.raises(ConfigError, match="diverged"):
        learner.predict(motion(1)[0])


def test_outputs_that_are_not_finite_are_one_error_of_a_look_ahead_and_of_its_step() -> None:
    learner = small()
    views = kernels.views(learner._network.sizes, learner._network.memory)
    views.output_weights[0] = np.inf
    with np.errstate(all="ignore"), pytest.raises(ConfigError, match="diverged"):
        look(learner, motion(1)[0][0], -1.0, 1.0)
    learner._next_activations[0] = np.nan
    with pytest.raises(ConfigError, match="diverged"):
        learner.advance()


def test_memory_is_divided_without_a_rest() -> None:
    sizes = kernels.Sizes(
        inputs=2, outputs=3, reservoir=5, reservoir_slots=4, output_slots=7, feedback_slot=6, sources=12
    )
    views = kernels.views(np.array(sizes), np.zeros(kernels.memory_size(sizes)))
    shapes = {name: view.shape for name, view in views._asdict().items()}
    assert shapes["reservoir_weights"] == (5, 4)
    assert shapes["output_weights"] == shapes["gathered"] == (3, 7)
    assert (shapes["a"], shapes["b"], shapes["x"]) == ((5,), (5,), (8,))
    assert shapes["z"] == shapes["slope_error"] == (12,)
    assert shapes["error"] == shapes["gamma"] == (3,)


def test_sums_run_over_every_place() -> None:
    values = np.arange(1.0, 9.0)
    assert kernels.sum_of_squares(values) == (values**2).sum()
    assert kernels.all_finite(values)
    for place in range(8):
        wrong = values.copy()
        wrong[place] = np.nan
        assert not kernels.all_finite(wrong.reshape(2, 4))
