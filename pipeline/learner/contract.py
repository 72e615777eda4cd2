"""Tests that every learning rule passes; needs pytest, and a test class of one's own with a `rule`."""

from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest

from pipeline.arrays import Floats
from pipeline.learner.controller import Controller
from pipeline.learner.look_ahead import look_ahead_of
from pipeline.learner.registry import config_from_dict, config_to_dict, find_rule, rule_names
from pipeline.learner.rule import OnlineLearner, Rule, Settings
from pipeline.learner.state import state_digest
from recorders.errors import ConfigError, ControllerError, MessageError

_STEPS = 256
_PERIOD = 64


class LearningRuleContract:
    """Tests of a rule, for a class that inherits them: all that nodes, verbs and files rely on.

    Attributes
    ----------
    rule : Rule
        The rule, which must be registered.
    settings : mapping
        Settings to test it with, where the defaults take too long.
    """

    rule: ClassVar[Rule]
    settings: ClassVar[dict[str, int | float]] = {}

    @property
    def config(self) -> Settings:
        """The configuration under test."""
        return self.rule.config.from_dict(self.settings)

    def learner(self) -> OnlineLearner:
        """Make a learner."""
        centres = np.linspace(-0.5, 0.5, self.config.outputs)
        return self.rule.learner(self.config, input_centre=centres[: self.config.inputs], output_centre=centres)

    def motion(self, steps: int) -> tuple[Floats, Floats]:
        """Return inputs of a closed motion, and targets that they decide."""
        phases = np.arange(steps)[:, np.newaxis] * (2.0 * np.pi / _PERIOD)
        u = 0.1 * np.sin(phases * (1 + np.arange(self.config.inputs) % 3) + np.arange(self.config.inputs))
        d = 0.1 * np.sin(phases * (1 + np.arange(self.config.outputs) % 3) + np.arange(self.config.outputs))
        return u, d

    def trained(self, pieces: int) -> OnlineLearner:
        """Return a learner after two epochs, whose steps came some at a time."""
        learner, (u, d) = self.learner(), self.motion(_STEPS)
        for epoch in range(2):
            learner.begin_epoch(epoch)
            for start in range(0, _STEPS, pieces):
                part = slice(start, start + pieces)
                learner.step(u[part], d[part], learning=True)
        return learner

    def test_it_is_registered(self) -> None:
        """It is found by the name that its configurations carry."""
        name = self.rule.config.rule
        assert name in rule_names()
        assert find_rule(name) is self.rule

    def test_a_configuration_is_plain_values(self) -> None:
        """They name the rule, and are all that there is to it."""
        config = self.config.fitted(seed=7, epochs=3)
        assert (config.seed, config.epochs) == (7, 3)
        assert config_from_dict(config_to_dict(config)) == config
        with pytest.raises(ConfigError, match="unknown learner setting"):
            self.rule.config.from_dict({"no such setting": 1})
        for wrong in ({"inputs": 0}, {"outputs": "21"}, {"seed": -1}, {"epochs": 0.5}):
            with pytest.raises(ConfigError):
                self.rule.config.from_dict(wrong)

    def test_what_is_shown_is_there(self) -> None:
        """A viewer shows arrays of the state."""
        shown, names = self.config.shown(), set(self.config.state_shapes())
        assert {*shown.drift.values(), *shown.spread} <= names
        assert shown.activity in {"", *names}

    def test_a_state_is_named_and_shaped_as_the_configuration_has_it(self) -> None:
        """In this order, and in float64."""
        shapes = {name: values.shape for name, values in self.trained(_STEPS).state().items()}
        assert list(shapes.items()) == list(self.config.state_shapes().items())
        assert {values.dtype for values in self.learner().state().values()} == {np.dtype(np.float64)}

    @pytest.mark.parametrize("pieces", [64, 8, 7, 1])
    def test_pieces_change_no_bit(self, pieces: int) -> None:
        """How steps are cut into calls does not matter."""
        assert state_digest(self.trained(pieces).state()) == state_digest(self.trained(_STEPS).state())

    def test_two_learners_are_equal(self) -> None:
        """Configuration and centres decide the state, and what is not in it."""
        one, other = self.learner(), self.learner()
        assert state_digest(one.state()) == state_digest(other.state())
        assert one.connections_digest() == other.connections_digest()

    def test_it_learns(self) -> None:
        """Learning changes the state; predicting makes no learner of it."""
        learner, (u, d) = self.trained(_STEPS), self.motion(_STEPS)
        before = np.abs(self.learner().step(u, d, learning=False) - d).mean()
        assert np.abs(learner.step(u, d, learning=False) - d).mean() < before

    def test_outputs_come_before_the_update(self) -> None:
        """A prediction is scored from before its update."""
        u, d = self.motion(1)
        assert np.array_equal(self.trained(64).step(u, d, learning=True), self.trained(64).predict(u))

    def test_going_on_from_a_state_changes_no_bit(self) -> None:
        """A state is all that later steps depend on."""
        learner, resumed = self.trained(64), self.learner()
        resumed.load_state(learner.state())
        u, d = self.motion(50)
        assert np.array_equal(learner.step(u, d, learning=True), resumed.step(u, d, learning=True))
        assert state_digest(learner.state()) == state_digest(resumed.state())

    def test_going_back_to_a_state_changes_no_bit(self) -> None:
        """A step can be looked ahead to, and not taken."""
        learner, (u, _) = self.trained(64), self.motion(3)
        state = learner.state()
        outputs = learner.predict(u)
        learner.load_state(state)
        assert state_digest(learner.state()) == state_digest(state)
        assert np.array_equal(learner.predict(u), outputs)

    def test_a_look_ahead_is_the_next_step_to_the_bit(self) -> None:
        """It changes nothing; the step is taken when there is time, and other steps may come first."""
        (learner, predicting), (u, d) = (self.trained(64) for _ in range(2)), self.motion(20)
        outputs, limited, row = np.empty(self.config.outputs), np.empty(self.config.outputs), u[0].copy()
        limits = np.array([np.full(self.config.outputs, bound) for bound in (-0.01, 0.01)])
        ahead = look_ahead_of(learner)
        look_ahead = ahead.bind_look_ahead(row, limits=limits, outputs=outputs, limited=limited)
        for k in range(len(u)):
            row[:] = u[k]
            digest = state_digest(learner.state())
            assert look_ahead() == 0
            assert state_digest(learner.state()) == digest
            if k % 3:
                ahead.advance()
                expected = predicting.predict(u[k : k + 1])
            else:
                learner.step(u[k : k + 1], d[k : k + 1], learning=True)
                expected = predicting.step(u[k : k + 1], d[k : k + 1], learning=True)
            assert outputs.tobytes() == expected.tobytes()
            assert np.array_equal(limited, np.clip(outputs, *limits))
            assert state_digest(learner.state()) == state_digest(predicting.state())

    def test_a_state_is_a_copy(self) -> None:
        """Writing to it does not change the learner."""
        learner = self.learner()
        digest = state_digest(learner.state())
        for values in learner.state().values():
            values[...] = 1e9
        assert state_digest(learner.state()) == digest

    def test_what_is_no_state_is_refused_and_changes_nothing(self) -> None:
        """An array too few, too many, of another shape, or not finite."""
        learner = self.trained(64)
        state, digest = learner.state(), state_digest(learner.state())
        for name, values in state.items():
            fewer = {other: array for other, array in state.items() if other != name}
            for wrong in (fewer, {**state, name: np.zeros(3_333)}, {**state, name: np.full_like(values, np.nan)}):
                if values.size:
                    with pytest.raises(ControllerError, match="expected"):
                        learner.load_state(wrong)
        with pytest.raises(ControllerError, match="expected"):
            learner.load_state({**state, "more": np.zeros(1)})
        assert state_digest(learner.state()) == digest

    def test_washout_forgets_what_came_before(self) -> None:
        """After it, only what was learned counts."""
        u, _ = self.motion(30)
        one, other = self.trained(_STEPS), self.trained(_STEPS)
        other.predict(u)
        one.washout(u[0], steps=10)
        other.washout(u[0], steps=10)
        assert np.array_equal(one.predict(u), other.predict(u))

    @pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
    @pytest.mark.parametrize("name", ["u", "d"])
    def test_what_is_not_finite_is_refused_and_changes_nothing(self, name: str, value: float) -> None:
        """No step of the call is taken, wherever the row stands."""
        learner, rows = self.trained(_STEPS), dict(zip("ud", self.motion(5), strict=True))
        digest = state_digest(learner.state())
        rows[name][3, 2] = value
        with pytest.raises(MessageError, match=f"finite numbers in {name}"):
            learner.step(rows["u"], rows["d"], learning=True)
        if name == "u":
            with pytest.raises(MessageError):
                learner.predict(rows["u"])
            with pytest.raises(MessageError):
                learner.washout(rows["u"][3], steps=1)
        assert state_digest(learner.state()) == digest

    def test_targets_of_a_wrong_shape_are_refused(self) -> None:
        """An error names the shape that was expected."""
        n, (u, _) = self.config.outputs, self.motion(3)
        for shape in ((n,), (3, n - 1), (3, n + 1), (4, n), (3, n, 1)):
            with pytest.raises(MessageError, match="expected"):
                self.learner().step(u, np.zeros(shape), learning=True)

    def test_layout_and_type_of_the_rows_do_not_matter(self) -> None:
        """Arrays of any order, and lists."""
        one, other, (u, d) = self.learner(), self.learner(), self.motion(20)
        one.step(u, d, learning=True)
        other.step(np.asfortranarray(u), d.tolist(), learning=True)
        assert state_digest(one.state()) == state_digest(other.state())

    def test_a_controller_keeps_it_to_the_bit(self, tmp_path: Path) -> None:
        """A file is read back, and written again as the same bytes."""
        learner, first, second = self.trained(64), tmp_path / "first.npz", tmp_path / "second.npz"
        joints = tuple(f"joint {k}" for k in range(self.config.outputs - self.config.inputs))
        Controller.from_learner(learner, joints=joints, robot_toml="", robot_urdf="").save(first)
        loaded = Controller.load(first)
        loaded.save(second)
        assert first.read_bytes() == second.read_bytes()
        assert (loaded.rule, loaded.config, loaded.digest) == (
            self.rule.config.rule,
            self.config,
            state_digest(learner.state()),
        )
        u, d = self.motion(20)
        assert np.array_equal(loaded.learner().step(u, d, learning=True), learner.step(u, d, learning=True))
