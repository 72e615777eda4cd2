import dataclasses

import numpy as np
import pytest

from recorders.errors import MessageError
from recorders.messages.message_types import (
    Clock,
    Float64MultiArray,
    JointState,
    PoseStamped,
    String,
    TFMessage,
    TransformStamped,
)
from recorders.messages.validation import MAX_STAMP_NS


def test_arrays_are_copied_and_cannot_be_written():
    given = np.array([1.0, 2.0])
    message = JointState(0, ("a", "b"), given)
    given[0] = 9.0
    assert message.position.tolist() == [1.0, 2.0]
    with pytest.raises(ValueError, match="read-only"):
        message.position[0] = 5.0
    with pytest.raises(dataclasses.FrozenInstanceError):
        message.stamp_ns = 1  # type: ignore[misc]


def test_names_become_a_tuple_shared_by_all_messages():
    first = JointState(0, ["a", "b"], np.zeros(2))
    second = JointState(1, ("a", "b"), np.zeros(2))
    assert first.name == ("a", "b")
    assert first.name is second.name


@pytest.mark.parametrize(
    ("make", "expected"),
    [
        (lambda: JointState(0, ("a", "b"), np.zeros(3)), "JointState.position: expected 2 values.* found 3"),
        (lambda: JointState(0, ("a",), np.zeros(1), effort=np.zeros(2)), "JointState.effort"),
        (lambda: JointState(0, ("a",), np.zeros((1, 1))), r"expected shape \(n,\), found shape \(1, 1\)"),
        (lambda: JointState(0, "ab", np.zeros(2)), "JointState.name: expected a sequence, found 'ab'"),
        (lambda: JointState(0, (1,), np.zeros(1)), "JointState.name: expected a string, found 1"),
        (lambda: JointState(0, ([],), np.zeros(1)), "JointState.name: expected a string"),
        (lambda: JointState(0.5, (), np.zeros(0)), "JointState.stamp_ns: expected an integer, found 0.5"),
        (lambda: JointState(-1, (), np.zeros(0)), "JointState.stamp_ns: expected 0 to"),
        (lambda: PoseStamped(0, np.zeros(2)), r"PoseStamped.position: expected shape \(3,\), found shape \(2,\)"),
        (lambda: PoseStamped(0, np.zeros(3), orientation=np.zeros(3)), "PoseStamped.orientation"),
        (lambda: PoseStamped(0, np.zeros(3), frame_id=None), "PoseStamped.frame_id: expected a string"),
        (lambda: PoseStamped(0, ["x", "y", "z"]), "PoseStamped.position: expected numbers"),
        (lambda: PoseStamped(MAX_STAMP_NS + 1, np.zeros(3)), "PoseStamped.stamp_ns"),
        (lambda: String(b"bytes"), "String.data: expected a string"),
        (lambda: String("\ud800"), "String.data: expected text that UTF-8 can hold"),
        (lambda: Float64MultiArray(np.zeros((2, 2))), "Float64MultiArray.data"),
        (lambda: Float64MultiArray(np.zeros(2), dims=(("x", -1, 2),)), "Float64MultiArray.dims.size"),
        (lambda: Float64MultiArray(np.zeros(2), dims=("x",)), "expected .label, size, stride."),
        (lambda: TransformStamped(0, "a", "b", np.zeros(4)), "TransformStamped.translation"),
        (lambda: TFMessage((1,)), "TFMessage.transforms: expected TransformStamped, found int"),
        (lambda: Clock("now"), "Clock.clock_ns: expected an integer"),
    ],
)
def test_wrong_fields_are_refused_with_one_line(make, expected):
    with pytest.raises(MessageError, match=expected) as caught:
        make()
    assert "\n" not in str(caught.value)
