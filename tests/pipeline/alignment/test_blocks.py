"""Messages that are read many at a time hold what they hold one by one, whatever their layouts; odd ones are noted."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.alignment import blocks
from pipeline.alignment.blocks import BlockReader, Dropped, Kind, joints_kind, pose_kind
from pipeline.rotations import SHORTEST
from recorders.cdr.codec import decode_as, encode
from recorders.cdr.layouts import read_message
from recorders.errors import MessageError
from recorders.messages.message_types import JointState, PoseStamped

WANTED = ("elbow", "shoulder")
SECOND = 10**9
ODD = (0.0, -0.0, math.nan, math.inf, -math.inf, 1e-7, 1e-6, 1e200, 1.5, -2.0)

NUMBERS = st.sampled_from(ODD) | st.floats(-2.0, 2.0)
STAMPS = st.sampled_from([0, 1, SECOND - 1, SECOND, 2**31 * SECOND - 1, 1_700_000_000 * SECOND + 123_456_789])
FRAMES = st.sampled_from(["", "world", "cam", "Kamera ä"])


@st.composite
def poses(draw: Any) -> bytes:
    turn = draw(
        st.sampled_from([(0, 0, 0, 1), (0, 0, 0, 0), (0, 3, 0, 4), (0, 0, 0, 1e-6), (9e-7, 0, 0, 0)])
        | st.tuples(*[NUMBERS] * 4)
    )
    position = draw(st.just((1.0, 2.0, 3.0)) | st.tuples(*[NUMBERS] * 3))
    return encode(
        PoseStamped(draw(STAMPS), np.array(position), orientation=np.array(turn, dtype=float), frame_id=draw(FRAMES))
    )


@st.composite
def joints(draw: Any) -> bytes:
    names = draw(
        st.sampled_from([("shoulder", "elbow"), ("elbow", "shoulder"), ("thumb", "elbow", "shoulder")])
        | st.sampled_from([("elbow",), (), ("elbow", "elbow", "shoulder"), ("elbow", "toe")])
    )
    values = [draw(NUMBERS) for _ in names]
    position = draw(st.sampled_from([values, values, values, []]))
    velocity = draw(st.sampled_from([[], [math.nan] * len(names)]))
    stamp, frame = draw(STAMPS), draw(FRAMES)
    return encode(JointState(stamp, names, np.array(position), velocity=np.array(velocity), frame_id=frame))


@st.composite
def spoiled(draw: Any, messages: Any) -> bytes:
    """Return a message of which some bytes are others, missing or too many."""
    data = bytearray(draw(messages))
    kind = draw(
        st.sampled_from(
            ["whole"] * 4 + ["seconds", "nanoseconds", "byte", "head", "order", "cut", "more", "none", "signal"]
        )
    )
    if kind == "seconds":
        data[4:8] = draw(st.sampled_from([2**31 - 1, 2**31, 2**32 - 1])).to_bytes(4, "little")
    elif kind == "nanoseconds":
        data[8:12] = draw(st.sampled_from([SECOND - 1, SECOND, 2**32 - 1])).to_bytes(4, "little")
    elif kind == "byte":
        data[draw(st.integers(0, len(data) - 1))] ^= 1 << draw(st.integers(0, 7))
    elif kind == "head":
        data[draw(st.integers(0, 3))] ^= 1
    elif kind == "order":
        data[1] = 0
    elif kind in ("cut", "none"):
        del data[draw(st.integers(1, len(data) - 1)) if kind == "cut" else 0 :]
    elif kind == "signal":
        data[-8:] = b"\1\0\0\0\0\0\xf0\x7f"  # a NaN that a sum would warn of
    elif kind == "more":
        data += bytes(draw(st.integers(1, 4)))
    return bytes(data)


def plainly(kind: Kind, data: bytes) -> tuple[int, Any, Dropped, str | None]:
    """Return stamp, values, reason and frame of one message, as the general codec reads it."""
    try:
        message: Any = read_message(kind.message.TYPE, data)
    except MessageError:
        return -1, None, Dropped.UNREADABLE, None
    stamp, frame = message.stamp_ns, message.frame_id
    if isinstance(message, JointState):
        apart = len(set(message.name)) == len(message.name) == len(message.position)
        if not apart or not set(message.name) >= set(WANTED):
            return stamp, None, Dropped.JOINTS_MISSING, frame
        values = [message.position[message.name.index(name)] for name in WANTED]
    else:
        values = [*message.position, *message.orientation]
    if not all(map(math.isfinite, values)):
        return stamp, None, Dropped.NOT_FINITE, frame
    if isinstance(message, PoseStamped):
        with np.errstate(over="ignore"):
            length = np.sqrt(sum(float(part) * float(part) for part in values[3:]))
        if not 1e-6 <= length < math.inf:
            return stamp, None, Dropped.NO_LENGTH, frame
        values[3:] = [part / length for part in values[3:]]
    return stamp, values, Dropped.NOT, frame


def check_against_the_plain_version(kind: Kind, payloads: Sequence[bytes], cut: int) -> None:
    reader = BlockReader(kind)
    for part in (payloads[:cut], payloads[cut:]):
        block = reader.read(part)
        expected = [plainly(kind, data) for data in part]
        assert block.stamps_ns.tolist() == [stamp for stamp, _, _, _ in expected]
        assert [Dropped(reason) for reason in block.dropped.tolist()] == [reason for _, _, reason, _ in expected]
        for row, (_, values, _, _) in zip(block.values, expected, strict=True):
            if values is not None:
                np.testing.assert_allclose(row, values, rtol=1e-15, atol=0)
        found = {place: frame for frame, indices in block.frames.items() for place in indices.tolist()}
        assert sum(map(len, block.frames.values())) == len(found)
        for place, (_, _, _, frame) in enumerate(expected):
            assert frame is None or found[place] == frame


@settings(max_examples=40)
@given(st.lists(spoiled(poses()), max_size=12), st.integers(0, 6))
def test_poses_are_those_of_the_plain_version(payloads: list[bytes], cut: int) -> None:
    check_against_the_plain_version(pose_kind(), payloads, cut)


@settings(max_examples=40)
@given(st.lists(spoiled(joints()), max_size=12), st.integers(0, 6))
def test_joints_are_those_of_the_plain_version(payloads: list[bytes], cut: int) -> None:
    check_against_the_plain_version(joints_kind(WANTED), payloads, cut)


@pytest.mark.parametrize("message", [PoseStamped(1, np.zeros(3)), JointState(1, WANTED, np.zeros(2))])
def test_stamps_that_no_message_can_have_are_seen_among_messages_of_one_layout(message: Any) -> None:
    kind = pose_kind() if isinstance(message, PoseStamped) else joints_kind(WANTED)
    data = encode(message)
    numbers = [(0, 1), (2**31 - 1, SECOND - 1), (0, SECOND), (2**31, 0), (2**32 - 1, 2**32 - 1), (5, 6)]
    payloads = [data[:4] + np.array(pair, "<u4").tobytes() + data[12:] for pair in numbers]
    block = BlockReader(kind).read(payloads)
    assert block.stamps_ns.tolist() == [1, 2**31 * SECOND - 1, -1, -1, -1, 5 * SECOND + 6]
    assert [Dropped(reason).name for reason in block.dropped] == ["NOT"] * 2 + ["UNREADABLE"] * 3 + ["NOT"]


def test_the_shortest_quaternion_that_has_a_direction_is_taken() -> None:
    turns = [(0.0, 0.0, 0.0, part) for part in (SHORTEST, SHORTEST * 0.999)]
    payloads = [encode(PoseStamped(1, np.zeros(3), orientation=np.array(turn))) for turn in turns]
    block = BlockReader(pose_kind()).read(payloads)
    assert block.dropped.tolist() == [Dropped.NOT, Dropped.NO_LENGTH]
    assert block.values[0, 3:].tolist() == [0.0, 0.0, 0.0, 1.0]


def test_the_first_message_that_cannot_be_read_is_explained() -> None:
    reader = BlockReader(pose_kind())
    good = encode(PoseStamped(1, np.zeros(3)))
    with pytest.raises(MessageError) as error:
        read_message(PoseStamped.TYPE, good[:20])
    assert reader.first_error == ""
    for payloads in ([good, good[:20], good], [b"\0\1\0\0", good]):
        reader.read(payloads)
        assert reader.first_error == str(error.value)


def test_layouts_from_anyone_fill_no_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    """Messages of many sizes are read all the same."""
    assert blocks._MAX_LAYOUTS < 1000
    monkeypatch.setattr(blocks, "_MAX_LAYOUTS", 3)
    reader = BlockReader(pose_kind())
    for _ in range(2):
        for size in range(12):
            block = reader.read([encode(PoseStamped(5 + size, np.full(3, size), frame_id="x" * 8 * size))] * 2)
            assert (block.stamps_ns.tolist(), block.values[:, 0].tolist()) == ([5 + size] * 2, [size] * 2)
            assert len(reader._layouts) <= 3


def test_messages_of_a_known_layout_are_read_together(monkeypatch: pytest.MonkeyPatch) -> None:
    """A layout is learned from one message, and no other of it is decoded; those of others are, one by one."""
    decoded: list[bytes] = []

    def counted(kind: Any, data: bytes) -> Any:
        decoded.append(data)
        return decode_as(kind, data)

    monkeypatch.setattr(blocks, "decode_as", counted)
    alike = [encode(PoseStamped(stamp, np.full(3, stamp), frame_id="cam")) for stamp in range(1, 50)]
    other = encode(PoseStamped(9, np.zeros(3), frame_id="map"))
    reader = BlockReader(pose_kind())
    reader.read([*alike, other, *alike])
    assert decoded == [alike[0], other]
    reader.read(alike)
    assert len(decoded) == 2
    longer = encode(PoseStamped(9, np.zeros(3), frame_id="a camera far away"))
    for _ in range(3):
        reader.read([longer, alike[0]])
    assert decoded[2:] == [longer]


def test_every_reason_has_a_number_and_words_of_its_own() -> None:
    assert [*Dropped.__members__] == [reason.name for reason in Dropped]
    assert len({reason.text for reason in Dropped}) == len(Dropped)
    assert np.zeros(1, np.int8)[0] == Dropped.NOT
