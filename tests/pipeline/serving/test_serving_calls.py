"""The two compiled calls of a served controller do what the learner's own methods do, to the bit."""

import numpy as np
import pytest

from pipeline.learner.rules.reservoir import kernels
from pipeline.learner.rules.reservoir.config import LearnerConfig
from pipeline.learner.rules.reservoir.learner import Learner
from pipeline.learner.state import state_digest
from pipeline.robot.config import load_robot
from pipeline.serving.codec import CommandEncoder
from pipeline.serving.compiled_calls import ServingCalls
from recorders.cdr.codec import decode_as, encode
from recorders.errors import ConfigError
from recorders.messages.message_types import JointState, PoseStamped

ROBOT = load_robot("asimo")
NEAR_M = 0.25


def make(seed: int = 1) -> Learner:
    centre = np.concatenate([ROBOT.input_centre, ROBOT.comfort])
    return Learner(LearnerConfig(seed=seed, output_output_density=0.3), input_centre=centre[:6], output_centre=centre)


def bind(learner: Learner, *, margin: float = np.inf) -> tuple[ServingCalls, CommandEncoder]:
    """Return calls for joints that may leave comfort by a margin, and the encoder that they write to."""
    encoder, limits = CommandEncoder(ROBOT.joints), np.array([ROBOT.comfort - margin, ROBOT.comfort + margin])
    return ServingCalls(learner, encoder, limits=limits, centres=ROBOT.input_centre, near_m=NEAR_M), encoder


def motion(steps: int) -> np.ndarray:
    return ROBOT.input_centre + 0.2 * np.sin(np.arange(steps)[:, np.newaxis] + np.arange(6))


def poses(stamp_ns: int, u: np.ndarray) -> tuple[bytes, bytes]:
    left, right = (encode(PoseStamped(stamp_ns, hand)) for hand in u.reshape(2, 3))
    return left, right


def test_commands_and_states_are_those_of_predicting() -> None:
    answering, predicting, margin = make(), make(), 0.004
    for learner in (answering, predicting):  # leaves an error, which a step without a target takes away
        learner.step(motion(1), np.append(motion(1)[0], ROBOT.comfort)[np.newaxis] + 0.01, learning=True)
    calls, encoder = bind(answering, margin=margin)
    counts = np.zeros(len(ROBOT.joints), dtype=int)
    for k, u in enumerate(motion(64)):
        stamp_ns = k * 10**8 + 7
        assert calls.answer(*poses(stamp_ns, u), stamp_ns - 1) == stamp_ns
        assert state_digest(answering.state()) == state_digest(predicting.state())
        (outputs,) = predicting.predict([u])
        command = decode_as(JointState, encoder.encoded())
        assert command.stamp_ns == stamp_ns
        assert calls.u.tobytes() == u.tobytes()
        assert calls.outputs.tobytes() == outputs.tobytes()
        assert np.array_equal(command.position, np.clip(outputs[6:], ROBOT.comfort - margin, ROBOT.comfort + margin))
        answering.check(calls.settle(advance=True))
        assert state_digest(answering.state()) == state_digest(predicting.state())
        counts += command.position != outputs[6:]
    assert calls.clipped.tolist() == counts.tolist()
    assert 0 < counts.sum() < 64 * counts.size


def test_without_an_advance_the_state_stays() -> None:
    learner = make()
    calls, _ = bind(learner, margin=1e-6)
    before = state_digest(learner.state())
    assert calls.answer(*poses(5, motion(1)[0]), 4) == 5
    learner.check(calls.settle(advance=False))
    assert state_digest(learner.state()) == before
    assert calls.clipped.sum() > 0


@pytest.mark.parametrize("sign", [-1.0, 1.0])
@pytest.mark.parametrize("axis", range(6))
def test_a_position_beyond_the_usual_is_not_answered(axis: int, sign: float) -> None:
    calls, _ = bind(make())
    for distance, answered in ((0.2499, 1), *((far, kernels.UNUSUAL) for far in (0.2501, np.inf, np.nan))):
        u = ROBOT.input_centre.copy()
        u[axis] += sign * distance
        assert calls.answer(*poses(1, u), 0) == answered


def test_a_stamp_that_is_not_later_is_not_answered() -> None:
    calls, _ = bind(make())
    assert calls.answer(*poses(7, ROBOT.input_centre), 7) == kernels.UNUSUAL
    assert calls.answer(*poses(7, ROBOT.input_centre), 6) == 7


def test_hands_of_different_instants_are_no_pair() -> None:
    calls, _ = bind(make())
    (left, _), (_, right) = poses(7, ROBOT.input_centre), poses(8, ROBOT.input_centre)
    assert calls.answer(left, right, 0) == kernels.UNUSUAL
    assert calls.answer(right, left, 0) == kernels.UNUSUAL
    assert calls.answer(*poses(8, ROBOT.input_centre), 0) == 8


def learner_with(**weights: float) -> Learner:
    learner = make()
    state = learner.state()
    for name, weight in weights.items():
        state[name][:] = weight
    learner.load_state(state)
    return learner


def test_outputs_that_overflow_are_not_answered() -> None:
    calls, _ = bind(learner_with(input_output_weights=1.7e308))
    assert calls.answer(*poses(1, ROBOT.input_centre + 0.2), 0) == kernels.UNUSUAL


def test_a_state_that_overflows_after_its_command_is_one_clear_error() -> None:
    learner = learner_with(reservoir_reservoir_weights=1.7e308)
    calls, _ = bind(learner)
    assert calls.answer(*poses(1, ROBOT.input_centre + 0.2), 0) == 1
    with pytest.raises(ConfigError, match="no longer finite"):
        learner.check(calls.settle(advance=True))


def test_arrays_with_gaps_are_refused() -> None:
    calls, _ = bind(make())
    with pytest.raises(ValueError, match="side by side"):
        kernels.addresses(calls._served._replace(u=np.zeros(12)[::2]))


@pytest.mark.parametrize("wrong", [{"limits": np.zeros((2, 14))}, {"limits": np.zeros(30)}, {"centres": np.zeros(3)}])
def test_what_is_not_of_one_size_is_refused(wrong: dict[str, np.ndarray]) -> None:
    right = {"limits": np.zeros((2, 15)), "centres": ROBOT.input_centre}
    with pytest.raises(ValueError, match=r"expected 6 inputs and centres, limits \(2, 15\)"):
        ServingCalls(make(), CommandEncoder(ROBOT.joints), near_m=NEAR_M, **{**right, **wrong})
