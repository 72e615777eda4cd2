"""Frames survive the wire to the bit, and bytes that are no frame are refused in one way."""

from contextlib import suppress

import pytest
from hypothesis import given
from hypothesis import strategies as st

from recorders.errors import MessageError, WireError
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import TOPICS
from recorders.protocol.frames import NO_RUN, Frame, FrameType, live_attachment, pack, unpack
from recorders.protocol.stream import Offer, Progress
from recorders.wire.keys.namespace import message_key

RUN, SENDER = bytes(range(16)), bytes(range(16, 32))

stamped = st.builds(
    lambda topic, data, sequence, time: RecordedMessage(topic.name, topic.type, data, sequence, time),
    st.sampled_from(list(TOPICS.values())),
    st.binary(max_size=200),
    st.integers(0, 2**32 - 1),
    st.integers(0, 2**64 - 1),
)
indices = st.integers(0, 2**64 - 1)


@given(message=stamped, index=indices)
def test_a_single_message_survives(message: RecordedMessage, index: int) -> None:
    frame = Frame(FrameType.MESSAGE, RUN, SENDER, index, (message,))
    assert unpack(message.topic, *pack(frame)) == frame


@given(messages=st.lists(stamped, max_size=20), index=indices)
def test_a_batch_survives(messages: list[RecordedMessage], index: int) -> None:
    frame = Frame(FrameType.BATCH, RUN, SENDER, index, tuple(messages))
    assert unpack("/replay/batch", *pack(frame)) == frame


def test_the_payload_of_a_single_message_is_its_cdr_bytes() -> None:
    message = RecordedMessage("/clock", TOPICS["/clock"].type, b"any bytes", 3, 4)
    assert pack(Frame(FrameType.MESSAGE, RUN, SENDER, 0, (message,)))[0] == message.data


@given(message=stamped, publisher=st.binary(min_size=16, max_size=16))
def test_a_live_attachment_is_that_of_a_message_of_no_run(message: RecordedMessage, publisher: bytes) -> None:
    frame = Frame(FrameType.MESSAGE, NO_RUN, publisher, message.sequence, (message,))
    assert live_attachment(message.sequence, message.log_time_ns, publisher) == pack(frame)[1]


@pytest.mark.parametrize("kind", [FrameType.END, FrameType.ABORT])
def test_the_end_survives(kind: FrameType) -> None:
    frame = Frame(kind, RUN, SENDER, 7, reason="disk full" if kind is FrameType.ABORT else "")
    assert unpack("/replay/batch", *pack(frame)) == frame


@given(payload=st.binary(max_size=300), attachment=st.binary(max_size=80))
def test_random_bytes_are_refused_with_a_message_error(payload: bytes, attachment: bytes) -> None:
    with pytest.raises(MessageError):
        unpack("/clock", payload, attachment)


@given(data=st.data())
def test_damaged_batches_never_raise_anything_else(data: st.DataObject) -> None:
    messages = tuple(RecordedMessage("/clock", TOPICS["/clock"].type, b"12345", n, n) for n in range(3))
    payload, attachment = pack(Frame(FrameType.BATCH, RUN, SENDER, 0, messages))
    cut = payload[: data.draw(st.integers(0, len(payload)))]
    flipped = bytearray(cut)
    if flipped:
        flipped[data.draw(st.integers(0, len(flipped) - 1))] ^= data.draw(st.integers(1, 255))
    with suppress(MessageError):
        unpack("/replay/batch", bytes(flipped), attachment)


def test_keys_are_topics_without_the_leading_slash() -> None:
    assert message_key("lab", "/hand/left/target") == "lab/hand/left/target"


def test_offer_and_progress_survive() -> None:
    offer = Offer(
        run="0f" * 16, schedule={"epochs": 1}, logs=[{"name": "a"}], robot={"toml": "x"}, sender="ab" * 16, window=7
    )
    assert Offer.from_json(offer.to_json()) == offer
    progress = Progress(run="r", next=1, received=2, result={"a": 1}, error=None)
    assert Progress.from_json(progress.to_json()) == progress


@given(st.binary(max_size=100))
def test_random_json_is_refused(data: bytes) -> None:
    for kind in (Offer, Progress):
        with pytest.raises(WireError):
            kind.from_json(data)


@pytest.mark.parametrize(
    "change", [{"run": "xyz"}, {"run": "ab"}, {"window": True}, {"window": 0}, {"version": 99}, {"logs": None}]
)
def test_a_malformed_offer_is_refused(change: dict[str, object]) -> None:
    import json

    fields = json.loads(Offer(run="0f" * 16, schedule={}, logs=[]).to_json())
    with pytest.raises(WireError):
        Offer.from_json(json.dumps(fields | change).encode())
