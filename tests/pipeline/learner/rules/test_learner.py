"""The learner is the paper's to the letter, and its state depends on nothing but config, seed and messages."""

import dataclasses
import importlib.util
import json
from pathlib import Path

import numpy as np
import pytest

from pipeline.learner.contract import LearningRuleContract
from pipeline.learner.rules.reservoir import RULE, kernels
from pipeline.learner.rules.reservoir.config import LearnerConfig
from pipeline.learner.rules.reservoir.learner import Learner
from pipeline.learner.state import state_digest
from pipeline.seeding import uniforms
from recorders.errors import ConfigError, ControllerError, MessageError

_spec = importlib.util.spec_from_file_location("reference_learner", Path(__file__).with_name("reference_learner.py"))
reference = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(reference)

CENTRE = {"input_centre": np.linspace(0.2, 0.8, 6), "output_centre": np.linspace(-0.5, 0.5, 21)}
SMALL = LearnerConfig(reservoir=40, outputs=8, epochs=3)


def motion(steps, outputs=21, *, start=0):
    """A smooth closed motion u [m] and a smooth redundant posture map d of it, about the centres."""
    phase = np.arange(start, start + steps)[:, np.newaxis] * (2.0 * np.pi / 64.0)
    u = 0.1 * np.sin(phase * [1, 2, 3, 1, 2, 3] + np.arange(6))
    following = 0.1 * np.sin((phase + 2.0 * np.pi / 64.0) * [1, 2, 3, 1, 2, 3] + np.arange(6))
    mix = 2.0 * uniforms(0, "mix", count=6 * (outputs - 6)).reshape(6, -1) - 1.0
    joints = np.tanh(2.0 * u @ mix)
    d = np.concatenate((following, joints), axis=1)
    return u + CENTRE["input_centre"], d + CENTRE["output_centre"][:outputs]


def make(config=None, **changes):
    config = dataclasses.replace(config or LearnerConfig(), **changes)
    return Learner(config, input_centre=CENTRE["input_centre"], output_centre=CENTRE["output_centre"][: config.outputs])


# the equations


@pytest.mark.parametrize("output_output_density", [0.0, 0.5])
def test_a_thousand_training_steps_agree_with_plain_numpy(output_output_density):
    learner = make(output_output_density=output_output_density)
    plain = reference.ReferenceLearner(learner)
    u, d = motion(1001)
    outputs = learner.step(u, d, learning=True)
    for k in range(len(u)):
        x = plain.step(u[k] - learner.input_centre, d[k] - learner.output_centre, eta=0.15, zeta=0.015, learning=True)
        np.testing.assert_allclose(outputs[k] - learner.output_centre, x, rtol=0, atol=1e-12)
    assert_same_state(learner, plain, 1e-12)


def assert_same_state(learner, plain, tolerance):
    state = learner.state()
    for name, found in {"a": plain.a, "b": plain.b, "x": plain.x, "y": plain.y, "e": plain.e}.items():
        np.testing.assert_allclose(state[name], found, rtol=tolerance, atol=tolerance, err_msg=name)
    for name in ("reservoir_output", "output_output"):
        targets, sources = learner.connections(name)
        first = 0 if name == "output_output" else plain.outputs
        np.testing.assert_allclose(state[f"{name}_weights"], plain.w_net[targets, first + sources], atol=tolerance)
    targets, sources = learner.connections("input_output")
    np.testing.assert_allclose(state["input_output_weights"], plain.w_in[targets, sources], atol=tolerance)


def tiny():
    """One input, one output, one reservoir neuron, everything connected, with round numbers everywhere."""
    density = {f"{kind}_density": 1.0 for kind in ("input_reservoir", "input_output", "reservoir_reservoir")}
    density |= {f"{kind}_density": 1.0 for kind in ("reservoir_output", "output_reservoir", "output_output")}
    config = LearnerConfig(
        reservoir=1,
        inputs=1,
        outputs=1,
        bpdc_rate_start=0.5,
        bpdc_epsilon=0.25,
        ip_rate_start=0.1,
        ip_mu=0.5,
        **density,
    )
    learner = Learner(config, input_centre=[0.0], output_centre=[0.0])
    weights = {"input_reservoir": 0.5, "reservoir_reservoir": 0.25, "output_reservoir": -0.5}
    weights |= {"input_output": 2.0, "reservoir_output": 1.0, "output_output": -1.0}
    state = {f"{name}_weights": [weight] for name, weight in weights.items()}
    state |= {"a": [2.0], "b": [0.5], "x": [9.0, 9.0], "y": [0.5, 0.25], "e": [0.4], "epoch": [0.0]}
    learner.load_state({name: np.array(values) for name, values in state.items()})
    return learner


def test_one_step_worked_by_hand():
    learner = tiny()
    output = learner.step([[1.0]], [[1.0]], learning=True)
    # (1): output 2*1 + 1*0.25 - 1*0.5 = 1.75; reservoir 0.5*1 + 0.25*0.25 - 0.5*0.5 = 0.3125
    assert output.tolist() == [[1.75]]
    state = {name: values.tolist() for name, values in learner.state().items()}
    assert state["x"] == [1.75, 0.3125]
    # e = 0.75; (7): gamma = -0.75 + (-1) * 0.5 * (1 - 0.5) * 0.4 = -0.85
    assert state["e"] == [0.75]
    # rate = 0.5 / (0.5^2 + 0.25^2 + 1^2 + 0.25) = 0.32; rate * gamma = -0.272; (5), (6):
    assert state["reservoir_output_weights"] == pytest.approx([1.0 - 0.272 * 0.25], rel=1e-15)
    assert state["output_output_weights"] == pytest.approx([-1.0 - 0.272 * 0.5], rel=1e-15)
    assert state["input_output_weights"] == pytest.approx([2.0 - 0.272 * 1.0], rel=1e-15)
    # (3): reservoir 1 / (1 + exp(-2 * 0.3125 - 0.5)) = 1 / (1 + exp(-1.125)), output 1 / (1 + exp(-1.75))
    assert state["y"] == pytest.approx([0.8519528019683106, 0.7549149868676283], rel=1e-15)
    # (8), (9), mu = 0.5: delta b = 0.1 (1 - 4 y + 2 y^2), delta a = 0.1 / 2 + 0.3125 delta b
    delta_b = 0.1 * (1.0 - 4.0 * 0.7549149868676283 + 2.0 * 0.7549149868676283**2)
    assert state["b"] == pytest.approx([0.5 + delta_b], rel=1e-15)
    assert state["a"] == pytest.approx([2.0 + 0.05 + 0.3125 * delta_b], rel=1e-15)
    # what does not lead to an output stays fixed
    assert [state[f"{name}_weights"] for name in ("input_reservoir", "reservoir_reservoir", "output_reservoir")] == [
        [0.5],
        [0.25],
        [-0.5],
    ]


def test_outputs_are_formed_before_the_update():
    learning, idle = make(), make()
    u, d = motion(1)
    assert np.array_equal(learning.step(u, d, learning=True), idle.predict(u))


def test_without_learning_only_the_activity_changes():
    learner = make()
    before = learner.state()
    learner.step(*motion(64), learning=False)
    after = learner.state()
    changed = {name for name in before if not np.array_equal(before[name], after[name])}
    assert changed == {"x", "y", "e"}


def test_learning_changes_weights_to_the_outputs_and_the_reservoirs_a_and_b_alone():
    learner = make(output_output_density=0.3)
    before = learner.state()
    learner.step(*motion(64), learning=True)
    after = learner.state()
    same = {name for name in before if np.array_equal(before[name], after[name])}
    assert same == {"input_reservoir_weights", "reservoir_reservoir_weights", "output_reservoir_weights", "epoch"}


def test_intrinsic_plasticity_leaves_the_outputs_alone():
    learner = make()
    learner.step(*motion(200), learning=True)
    state = learner.state()
    np.testing.assert_allclose(state["y"][:21], 1.0 / (1.0 + np.exp(-state["x"][:21])), rtol=1e-14)
    assert state["a"].shape == (300,)
    assert (state["a"] != 1.0).all()


def test_a_step_without_target_leaves_no_error():
    learner = make()
    learner.step(*motion(3), learning=False)
    assert learner.state()["e"].any()
    learner.predict(motion(1)[0])
    assert not learner.state()["e"].any()


def test_a_smooth_redundant_map_is_learned():
    """Thirty epochs of the paper's procedure: one cycle without learning, five with, one to look."""
    learner, (u, d) = make(epochs=30), motion(256)
    errors = []
    for epoch in range(30):
        learner.begin_epoch(epoch)
        for cycle in range(7):
            outputs = learner.step(u, d, learning=1 <= cycle <= 5)
        errors.append(np.abs(outputs - d)[:, 6:].mean())
    assert errors[-1] < 0.1 * errors[0]
    assert errors[-1] < 0.1 * np.abs(d - d.mean(axis=0))[:, 6:].mean()


# Table I


def test_defaults_are_table_one():
    sizes = {part.name: (part.count, part.initial_range) for part in LearnerConfig().connections()}
    assert sizes == {
        "input_reservoir": (360, 0.1),
        "reservoir_reservoir": (1800, 0.02),
        "output_reservoir": (1260, 0.1),
        "input_output": (126, 0.1),
        "reservoir_output": (1260, 0.1),
        "output_output": (0, 0.1),
    }


@pytest.mark.parametrize("density", [0.0, 0.01, 0.2, 0.77, 1.0])
def test_every_neuron_hears_as_many_as_any_other_or_one_more(density):
    learner = make(reservoir_output_density=density, output_output_density=density)
    for name, sources in (("reservoir_output", 300), ("output_output", 21)):
        connections = learner.connections(name)
        degrees = np.bincount(connections.targets, minlength=21)
        assert len(connections.targets) == round(density * sources * 21)
        assert degrees.max() - degrees.min() <= 1
        assert len(set(zip(*map(np.ndarray.tolist, connections), strict=True))) == len(connections.targets)


def test_initial_weights_fill_their_range():
    learner = make()
    for part in LearnerConfig().connections():
        weights = learner.state()[f"{part.name}_weights"]
        if part.count:
            assert 0.9 * part.initial_range < np.abs(weights).max() <= part.initial_range
            assert np.abs(weights.mean()) < 0.2 * part.initial_range


def test_rates_fall_exponentially_from_start_to_end():
    learner = make()
    rates = []
    for epoch in (0, 74, 75, 149, 200):
        learner.begin_epoch(epoch)
        rates.append((learner.bpdc_rate, learner.ip_rate))
    assert rates[0] == (0.15, 0.015)
    assert rates[3] == pytest.approx((0.025, 0.0025), rel=1e-14)
    assert rates[2][0] / rates[1][0] == pytest.approx((1.0 / 6.0) ** (1.0 / 149.0), rel=1e-14)
    assert rates[4] == rates[3]


# seeds, epochs, pieces


def test_the_activity_at_the_start_of_an_epoch_depends_on_seed_and_epoch_alone():
    def start(learner, epoch):
        learner.begin_epoch(epoch)
        return learner.state()["x"]

    busy = make()
    busy.step(*motion(50), learning=True)
    assert np.array_equal(start(busy, 7), start(make(), 7))
    assert not np.array_equal(start(busy, 7), start(busy, 8))
    assert not np.array_equal(start(busy, 7), start(make(seed=1), 7))
    assert 0.09 < np.abs(start(busy, 7)).max() <= 0.1
    state = busy.state()
    arguments = state["a"] * state["x"][21:] + state["b"]
    np.testing.assert_allclose(state["y"][21:], 1.0 / (1.0 + np.exp(-arguments)), rtol=1e-14)


def test_seeds_draw_different_networks():
    assert make().connections_digest() == make(epochs=9).connections_digest() != make(seed=1).connections_digest()


def test_the_connections_digest_sees_where_connections_come_from():
    """With a whole number of connections for each neuron, seeds draw other sources only."""
    halves = {f"{ends}_density": 0.5 for ends in ("input_reservoir", "input_output", "reservoir_reservoir")}
    halves |= {f"{ends}_density": 0.5 for ends in ("reservoir_output", "output_reservoir")}
    one, other = (make(reservoir=12, outputs=8, seed=seed, **halves) for seed in (0, 1))
    names = [connection.name for connection in one.config.connections() if connection.count]
    assert len(names) == 5
    for name in names:
        assert np.array_equal(one.connections(name).targets, other.connections(name).targets)
    assert any(not np.array_equal(one.connections(name).sources, other.connections(name).sources) for name in names)
    assert one.connections_digest() != other.connections_digest()


@pytest.mark.parametrize("part", ["output_weights", "a", "b", "x"])
@pytest.mark.parametrize("wrong", [np.nan, np.inf])
def test_whatever_part_of_the_state_is_no_number_it_is_said_at_once(part, wrong):
    """In the step that sees it: what is learned or commanded afterwards would already be of no use."""
    for place in range(8):
        learner = make(SMALL)
        views = learner._network._views
        learner.predict(motion(3, outputs=8)[0])
        if part == "x":
            views.x[place] = wrong
            assert not kernels.is_finite(views)
            continue
        getattr(views, part).reshape(-1)[place] = wrong
        with pytest.raises(ConfigError, match="no longer finite"):
            learner.predict(motion(1, outputs=8)[0])


@pytest.mark.parametrize("place", range(6))
def test_a_number_that_is_none_is_refused_wherever_it_stands(place):
    learner, (u, d) = make(), motion(2)
    before = state_digest(learner.state())
    for wrong in (u, d):
        kept, wrong[0, place] = wrong[0, place], np.nan
        with pytest.raises(MessageError, match="found NaN or infinity"):
            learner.step(u, d, learning=True)
        wrong[0, place] = kept
    assert state_digest(learner.state()) == before


def test_other_input_and_target_centres_only_shift():
    u, d = motion(100)
    shifted = Learner(LearnerConfig(), input_centre=np.zeros(6), output_centre=np.zeros(21))
    expected = make().step(u, d, learning=True)
    found = shifted.step(u - CENTRE["input_centre"], d - CENTRE["output_centre"], learning=True)
    np.testing.assert_allclose(found + CENTRE["output_centre"], expected, atol=1e-12)


def test_the_digest_frames_names_and_shapes():
    one, two = np.array([1.0]), np.array([1.0, 2.0])
    digests = {
        state_digest({"a": one, "b": two}),
        state_digest({"a": two, "b": one}),
        state_digest({"b": one, "a": two}),
        state_digest({"a": one, "b": two}, np.array([3.0])),
        state_digest({"a": one, "b": two, "c": np.array([3.0])}),
        state_digest({"a": one, "b": two[np.newaxis]}),
    }
    assert len(digests) == 6


# foresight


def look_ahead(learner, u, *, margin=np.inf):
    """Outputs and limited outputs that the learner predicts, the last 15 kept within a margin about the centre."""
    centre = learner.output_centre[6:]
    outputs, limited = np.empty(21), np.empty(15)
    learner.look_ahead(u, limits=np.array([centre - margin, centre + margin]), outputs=outputs, limited=limited)
    return outputs, limited


@pytest.mark.parametrize("output_output_density", [0.0, 0.5])
def test_a_look_ahead_is_what_comes_to_the_bit_and_changes_nothing(output_output_density):
    learner, (u, d) = make(output_output_density=output_output_density), motion(64)
    for k in range(64):
        digest = state_digest(learner.state())
        outputs, limited = look_ahead(learner, u[k])
        assert state_digest(learner.state()) == digest
        assert limited.tobytes() == outputs[6:].tobytes()
        assert outputs.tobytes() == learner.step(u[k : k + 1], d[k : k + 1], learning=True).tobytes()


def test_a_look_ahead_does_not_enter_what_is_learned_next():
    looking, plain, (u, d) = make(), make(), motion(32)
    for k in range(32):
        look_ahead(looking, u[(k + 7) % 32])
        looking.step(u[k : k + 1], d[k : k + 1], learning=True)
    plain.step(u, d, learning=True)
    assert state_digest(looking.state()) == state_digest(plain.state())


def test_a_look_ahead_is_kept_within_limits():
    learner, (u, _) = make(), motion(1)
    outputs, limited = look_ahead(learner, u[0], margin=0.01)
    centre = learner.output_centre[6:]
    assert np.array_equal(limited, np.clip(outputs[6:], centre - 0.01, centre + 0.01))
    assert (limited != outputs[6:]).any()


@pytest.mark.parametrize(
    "wrong", [{"u": np.zeros(5)}, {"limits": np.zeros((2, 14))}, {"outputs": np.zeros(20)}, {"limited": np.zeros(22)}]
)
def test_arrays_of_wrong_size_are_refused_by_foresight(wrong):
    right = {"u": np.zeros(6), "limits": np.zeros((2, 15)), "outputs": np.zeros(21), "limited": np.zeros(15)}
    with pytest.raises(MessageError, match="sizes of the network"):
        make().look_ahead(**{**right, **wrong})


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_foresight_of_what_is_not_finite_is_refused(value):
    u = motion(1)[0][0]
    u[4] = value
    with pytest.raises(MessageError, match="finite numbers in u"):
        look_ahead(make(), u)


def test_foresight_that_overflows_is_one_clear_error():
    learner = make()
    state = learner.state()
    state["input_output_weights"][:] = 1e300
    learner.load_state(state)
    with pytest.raises(ConfigError, match="no longer finite"):
        look_ahead(learner, np.full(6, 1e10))


class TestReservoir(LearningRuleContract):
    rule = RULE


# wrong use


@pytest.mark.parametrize("name", ["a", "reservoir_output_weights", "epoch"])
def test_a_state_of_another_network_is_refused_and_changes_nothing(name):
    learner = make(SMALL)
    digest = state_digest(learner.state())
    wrong = [{k: v for k, v in learner.state().items() if k != name}, {**learner.state(), "more": np.zeros(1)}]
    wrong += [
        {**learner.state(), name: values} for values in (np.zeros(999), np.full_like(learner.state()[name], np.nan))
    ]
    for state in [*wrong, {**learner.state(), "epoch": np.array([0.5])}]:
        with pytest.raises(ControllerError, match="expected"):
            learner.load_state(state)
    assert state_digest(learner.state()) == digest


def test_divergence_is_one_clear_error():
    with pytest.raises(ConfigError, match=r"diverged in epoch 0: .* lower the rates"):
        make(bpdc_rate_start=1e200, bpdc_rate_end=1e200).step(*motion(100), learning=True)


@pytest.mark.parametrize("centre", [np.zeros(5), np.full(6, np.nan), [[0.0] * 6]])
def test_a_centre_that_does_not_fit_is_refused(centre):
    with pytest.raises(ConfigError, match="input_centre to be 6 finite"):
        Learner(LearnerConfig(), input_centre=centre, output_centre=np.zeros(21))


@pytest.mark.parametrize(
    ("name", "value"),
    [
        *[("reservoir", value) for value in (0, 2.0, True, 10**12)],
        *[("ip_mu", value) for value in (0.0, float("nan"), None)],
        *[("seed", -1), ("epochs", 0), ("inputs", "6"), ("bpdc_epsilon", 0), ("initial_state_range", -0.1)],
        *[("input_output_density", 1.5), ("bpdc_rate_end", 0.0), ("ip_rate_start", float("inf"))],
    ],
)
def test_a_setting_out_of_range_is_refused(name, value):
    with pytest.raises(ConfigError, match="expected"):
        LearnerConfig(**{name: value})


def test_a_network_larger_than_memory_is_refused():
    with pytest.raises(ConfigError, match="connections"):
        LearnerConfig(reservoir=1_000_000, reservoir_reservoir_density=1.0)


def test_a_configuration_survives_json():
    config = LearnerConfig(reservoir=17, seed=2**62, output_output_density=0.3)
    assert LearnerConfig.from_dict(json.loads(json.dumps(config.to_dict()))) == config
    with pytest.raises(ConfigError, match="unknown learner setting reservoire; there are reservoir, ") as caught:
        LearnerConfig.from_dict({"reservoire": 300})
    offered = set(str(caught.value).partition("there are ")[2].split(", "))
    assert offered == set(config.to_dict()) - {"inputs", "outputs", "epochs"}  # which follow from robot and schedule


def test_a_rule_can_be_switched_off():
    learner = make(ip_rate_start=0.0, ip_rate_end=0.0)
    learner.step(*motion(20), learning=True)
    assert (learner.state()["a"] == 1.0).all()


def test_the_digest_is_the_one_it_has_always_been():
    """It changes with the last bit of `exp`, the order of a sum, the meaning of a seed: never without a reason."""
    numbers = uniforms(0, "numbers", count=6000)
    learner = Learner(LearnerConfig(), input_centre=[0.0] * 6, output_centre=[0.0] * 21)
    for epoch in (0, 1):
        learner.begin_epoch(epoch * 100)
        learner.step(numbers[:1200].reshape(200, 6) * 0.2, numbers[1200:5400].reshape(200, 21), learning=True)
    assert state_digest(learner.state()) == "f4f7d7b76dd0c9d15c832658134905ec51157bbe3f1c0ed8078092eeee0f3a07"


def test_two_short_epochs_end_where_they_always_did():
    """Re-seeded activity, falling rates, every type of connection, and the washout before a test."""
    learner, (u, d) = make(SMALL, output_output_density=0.5), motion(40, 8)
    for epoch in range(2):
        learner.begin_epoch(epoch)
        learner.step(u, d, learning=False)
        learner.step(u, d, learning=True)
    trained = state_digest(learner.state())
    learner.washout(u[0], steps=3)
    assert (trained[:16], state_digest(learner.state())[:16]) == ("7615316ef89721b5", "fc3674184f9332b0")
