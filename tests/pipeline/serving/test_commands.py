"""Commands and steps of a served controller are what the learner's own methods do, to the bit."""

from typing import cast

import numpy as np
import pytest

from pipeline.learner.look_ahead import LookAhead, look_ahead_of
from pipeline.learner.rules.reservoir.config import LearnerConfig
from pipeline.learner.rules.reservoir.learner import Learner
from pipeline.learner.state import state_digest
from pipeline.robot.config import load_robot
from pipeline.serving.commands import Commander
from recorders.cdr.codec import decode_as
from recorders.errors import ConfigError
from recorders.messages.message_types import JointState

ROBOT = load_robot("asimo")


def make(seed: int = 1) -> Learner:
    centre = np.concatenate([ROBOT.input_centre, ROBOT.comfort])
    return Learner(LearnerConfig(seed=seed, output_output_density=0.3), input_centre=centre[:6], output_centre=centre)


class Slow:
    """A learner that cannot look ahead."""

    def __init__(self, learner: Learner) -> None:
        self.config, self.predict = learner.config, learner.predict
        self.state, self.load_state = learner.state, learner.load_state


def bind(learner: Learner | Slow, *, margin: float = np.inf) -> Commander:
    """Return the commands of joints that may leave comfort by a margin."""
    limits = np.array([ROBOT.comfort - margin, ROBOT.comfort + margin])
    return Commander(cast(Learner, learner), ROBOT.joints, limits=limits)


def motion(steps: int) -> np.ndarray:
    return ROBOT.input_centre + 0.2 * np.sin(np.arange(steps)[:, np.newaxis] + np.arange(6))


def command(commander: Commander, stamp_ns: int, u: np.ndarray) -> JointState:
    return decode_as(JointState, commander.command(stamp_ns, *u.tolist()))


@pytest.mark.parametrize("wrap", [lambda learner: learner, Slow])
def test_commands_and_states_are_those_of_predicting(wrap: type[Slow]) -> None:
    answering, predicting, margin = make(), make(), 0.004
    for learner in (answering, predicting):  # leaves an error, which a step without a target takes away
        learner.step(motion(1), np.append(motion(1)[0], ROBOT.comfort)[np.newaxis] + 0.01, learning=True)
    commander = bind(wrap(answering), margin=margin)
    counts = np.zeros(len(ROBOT.joints), dtype=int)
    for k, u in enumerate(motion(64)):
        message = command(commander, k * 10**8 + 7, u)
        assert state_digest(answering.state()) == state_digest(predicting.state())
        (outputs,) = predicting.predict([u])
        assert (message.stamp_ns, message.name) == (k * 10**8 + 7, ROBOT.joints)
        limited = np.clip(outputs[6:], ROBOT.comfort - margin, ROBOT.comfort + margin)
        assert message.position.tobytes() == limited.tobytes()
        commander.finish(advance=True)
        assert state_digest(answering.state()) == state_digest(predicting.state())
        counts += message.position != outputs[6:]
    assert commander.clipped.tolist() == counts.tolist()
    assert 0 < counts.sum() < 64 * counts.size


def test_a_learner_that_can_look_ahead_does_so_itself() -> None:
    learner, slow = make(), look_ahead_of(Slow(make()))
    assert look_ahead_of(learner) is learner
    assert isinstance(slow, LookAhead)
    assert not isinstance(slow, Slow)


def test_without_an_advance_the_state_stays() -> None:
    learner = make()
    commander = bind(learner, margin=1e-6)
    before = state_digest(learner.state())
    command(commander, 5, motion(1)[0])
    commander.finish(advance=False)
    assert state_digest(learner.state()) == before
    assert commander.clipped.sum() > 0


def test_what_else_the_learner_does_counts_in_the_next_command() -> None:
    """Its arrays are bound once, and stay its own."""
    learner, (u, other) = make(), motion(2)
    commander = bind(learner)
    learner.step([u], [np.append(u, ROBOT.comfort)], learning=True)
    learner.washout(u, steps=2)
    learner.begin_epoch(3)
    learner.load_state(make(seed=5).state())
    message = command(commander, 1, other)
    assert message.position.tobytes() == learner.predict([other])[0, 6:].tobytes()


def learner_with(**weights: float) -> Learner:
    learner = make()
    state = learner.state()
    for name, weight in weights.items():
        state[name][:] = weight
    learner.load_state(state)
    return learner


def test_outputs_that_overflow_are_one_clear_error() -> None:
    commander = bind(learner_with(input_output_weights=1.7e308))
    with pytest.raises(ConfigError, match="no longer finite"):
        command(commander, 1, ROBOT.input_centre + 0.2)


def test_a_state_that_overflows_after_its_command_is_one_clear_error() -> None:
    commander = bind(learner_with(reservoir_reservoir_weights=1.7e308))
    assert command(commander, 1, ROBOT.input_centre + 0.2).stamp_ns == 1
    with pytest.raises(ConfigError, match="no longer finite"):
        commander.finish(advance=True)
