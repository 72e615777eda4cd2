"""A learner's state as named arrays: what its digest is of, and what is no state."""

import hashlib

import numpy as np
import pytest

from pipeline.learner.state import MAX_NUMBERS, check_state, state_digest, state_numbers
from recorders.errors import ControllerError

SHAPES = {"weights": (2, 3), "bias": (3,)}
STATE = {"weights": np.arange(6.0).reshape(2, 3), "bias": np.array([0.5, -0.0, 1e-300])}


def test_a_state_digest_is_of_names_shapes_and_numbers_in_order() -> None:
    weights, bias = (STATE[name].astype("<f8").tobytes() for name in ("weights", "bias"))
    whole = b"weights 2x3\n" + weights + b"bias 3\n" + bias
    pending = np.array([0.25])
    assert state_digest(STATE) == hashlib.sha256(whole + b"pending 0\n").hexdigest()
    assert state_digest(STATE, pending) == hashlib.sha256(whole + b"pending 1\n" + pending.tobytes()).hexdigest()
    assert state_digest(dict(reversed(STATE.items()))) != state_digest(STATE)


def test_how_the_numbers_lie_in_memory_does_not_enter() -> None:
    turned = {**STATE, "weights": np.asfortranarray(STATE["weights"]).astype(">f8")}
    assert state_digest(turned) == state_digest(STATE)


def test_the_numbers_of_a_state_are_counted() -> None:
    assert state_numbers(SHAPES) == 9


def test_a_thousand_neurons_connected_to_each_fit_into_a_state_of_8_mib_at_most() -> None:
    assert state_numbers({"weights": (1_000, 1_000), "activities": (1_000,)}) < MAX_NUMBERS
    assert MAX_NUMBERS * np.dtype(float).itemsize <= 8 * 2**20


@pytest.mark.parametrize(
    ("changes", "found"),
    [
        ({"bias": None}, "expected state weights, bias; found weights$"),
        ({"more": np.zeros(1)}, "expected state weights, bias; found weights, bias, more$"),
        ({"weights": np.zeros((3, 2))}, r"expected state weights of shape \(2, 3\), found \(3, 2\)$"),
        ({"bias": np.array([0.0, np.nan, 0.0])}, "expected finite numbers in state bias, found NaN or infinity$"),
        ({"bias": np.array([0.0, np.inf, 0.0])}, "expected finite numbers in state bias, found NaN or infinity$"),
    ],
)
def test_arrays_that_are_no_state_are_refused(changes: dict[str, np.ndarray | None], found: str) -> None:
    check_state(SHAPES, STATE)
    changed = {name: values for name, values in {**STATE, **changes}.items() if values is not None}
    with pytest.raises(ControllerError, match=found):
        check_state(SHAPES, changed)
