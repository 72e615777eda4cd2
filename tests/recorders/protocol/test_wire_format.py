"""Bytes of version 2 of the protocol: whoever has the same version reads them, and refuses what they cannot mean."""

import json
import re
from typing import Any

import pytest
from sealed import KEY

from recorders.errors import MessageError, WireError
from recorders.messages.record import RecordedMessage
from recorders.protocol.frames import (
    MAX_PAYLOAD,
    SEAL_BYTES,
    Frame,
    FrameType,
    live_attachment,
    pack,
    stream_of,
    unpack,
)
from recorders.protocol.packets import Packet
from recorders.protocol.seals.sealing import ConsumerKeys, SenderSeals, question_number
from recorders.protocol.stream import MAX_MESSAGE, WINDOW_BYTES, Offer, Progress, asker, asking
from recorders.protocol.stream_digest import StreamDigests, find_digest

OFFER = Offer(
    run="ab" * 16,
    schedule={"epochs": 1},
    logs=[{"name": "a"}],
    robot={"toml": "x"},
    messages=3,
    sender="cd" * 16,
    window=7,
)
CLOCK = RecordedMessage("/clock", "rosgraph_msgs/msg/Clock", b"\1\2", 3, 4)
OTHER = RecordedMessage("/x", "pkg/msg/X", b"", 5, 6)
INSTANCE = bytes(range(100, 116))
IDENTITY = "ab" * 16 + "cd" * 16


def digests() -> StreamDigests:
    """Digests of a stream of these two messages."""
    found = StreamDigests()
    for consumer, start in {"b": 1, "a": 0, "c": 1}.items():
        found.begin(consumer, start)
    found.add(Frame(FrameType.BATCH, *OFFER.identity, 0, (CLOCK, OTHER)))
    return found


FRAMES = {  # frame, payload, attachment
    "message": (
        Frame(FrameType.MESSAGE, *OFFER.identity, 9, (CLOCK,)),
        "0102",
        f"02000000 03000000 {IDENTITY} 0900000000000000 0400000000000000",
    ),
    "batch": (
        Frame(FrameType.BATCH, *OFFER.identity, 9, (CLOCK, OTHER)),
        "0600 02000000 03000000 0400000000000000 2f636c6f636b 0102"
        "0c00 00000000 05000000 0600000000000000 2f7800706b672f6d73672f58",
        f"02010000 00000000 {IDENTITY} 0900000000000000 0000000000000000",
    ),
    "end": (
        Frame(FrameType.END, *OFFER.identity, 2, digests=digests().packed()),
        "0000000000000000 6f1ee1013a80da27477bdb4eb1f1b5cc075203880143c162c68c281964998015"
        "0100000000000000 41a34617afd4efe5597cc3a9e3491802b7ced163bf2ae7dac9aa8b160b0cd8e5",
        f"02020000 00000000 {IDENTITY} 0200000000000000 0000000000000000",
    ),
    "abort": (
        Frame(FrameType.ABORT, *OFFER.identity, 9, reason="why"),
        "776879",
        f"02030000 00000000 {IDENTITY} 0900000000000000 0000000000000000",
    ),
}


@pytest.mark.parametrize("name", FRAMES)
def test_frames(name: str) -> None:
    frame, payload, attachment = FRAMES[name]
    topic = "/clock" if name == "message" else "/replay/batch"
    packed = bytes.fromhex(payload), bytes.fromhex(attachment)
    assert pack(frame) == packed
    assert unpack(topic, *packed) == frame
    sealed = packed[1] + bytes(SEAL_BYTES)
    assert unpack(topic, packed[0], sealed) == frame
    assert stream_of(sealed) == OFFER.identity
    assert stream_of(packed[1]) is None
    for wrong in (b"", packed[1][:-1], sealed[:-1], b"\x03" + packed[1][1:], packed[1][:1] + b"\x04" + packed[1][2:]):
        with pytest.raises(MessageError, match=re.escape(topic)):
            unpack(topic, packed[0], wrong)


def test_a_frame_of_another_version_is_named_as_such() -> None:
    payload, attachment = pack(FRAMES["abort"][0])
    with pytest.raises(MessageError, match=r"/replay/batch: expected protocol version 2, found 3"):
        unpack("/replay/batch", payload, b"\x03" + attachment[1:])


def test_a_message_has_the_type_of_its_topic_or_else_the_one_that_comes_with_it() -> None:
    _, attachment = pack(FRAMES["message"][0])
    for topic, given, expected in (
        ("/clock", "", CLOCK.type),
        ("/clock", "pkg/msg/X", CLOCK.type),
        ("/x", "pkg/msg/X", "pkg/msg/X"),
        ("/x", "", ""),
    ):
        (message,) = unpack(topic, b"", attachment, type_name=given).messages
        assert message == RecordedMessage(topic, expected, b"", 3, 4)


def test_a_batch_is_refused_wherever_it_is_cut() -> None:
    frame, payload, attachment = FRAMES["batch"]
    whole = bytes.fromhex(payload)
    ends = {0: 0, 26: 1, len(whole): 2}
    for size in range(len(whole) + 1):
        if size in ends:
            found = unpack("/replay/batch", whole[:size], bytes.fromhex(attachment))
            assert found.messages == frame.messages[: ends[size]]
        else:
            with pytest.raises(MessageError, match=f"{size} bytes that are no frame of a replay"):
                unpack("/replay/batch", whole[:size], bytes.fromhex(attachment))


def test_live_messages_and_limits() -> None:
    assert live_attachment(3, 4).hex() == f"0200000003000000{'00' * 32}03000000000000000400000000000000"
    assert (MAX_MESSAGE, MAX_PAYLOAD, WINDOW_BYTES) == (67_108_864, 67_174_400, 67_108_864)


def test_digests_of_a_stream_are_those_from_where_each_consumer_takes_it() -> None:
    packed = digests().packed()
    assert find_digest(packed, 0) == digests().digest("a") == packed[8:40].hex()
    assert find_digest(packed, 1) == digests().digest("b") == digests().digest("c") == packed[48:80].hex()
    for none in (find_digest(packed, 2), find_digest(packed[:-1], 0), find_digest(b"", 0)):
        assert none == ""


def test_seals() -> None:
    seals = SenderSeals(KEY, OFFER.identity[1])
    theirs = ConsumerKeys(KEY, "learner", INSTANCE).seals(OFFER.identity[1])
    packet = Packet(*pack(FRAMES["message"][0]))
    message = seals.frame("/clock", packet, CLOCK.type)
    batch = seals.frame("/replay/batch", Packet(*pack(FRAMES["batch"][0])), "")
    question = seals.question("learner", "status", asking(OFFER))
    answer, acknowledgement = theirs.answer(question, b"{}"), theirs.acknowledgement(b"{}")
    assert (message.payload, message.attachment[:56]) == packet
    assert message.attachment[56:].hex() == "00000000000000000a170e09ae76707d5e3f1a9f1a5c707f"
    assert batch.attachment[56:].hex() == "0100000000000000ac7b1dc0d4c5ae094e8f33de533170ad"
    nobody, consumer = "00" * 16, INSTANCE.hex()
    assert question.attachment.hex() == f"{nobody}0200000000000000a3806d99f5b52aa7c47c0c6f3c8a0bae"
    assert answer.attachment.hex() == f"{consumer}0000000000000000fae3e2de2b2b154675a5c08dddea7635"
    assert acknowledgement.attachment.hex() == f"{consumer}01000000000000003b106520100585c2955152c9c202cbca"
    assert theirs.frame_number("/clock", message, CLOCK.type) == 0
    assert theirs.frame_number("/replay/batch", batch, CLOCK.type) == 1  # a batch has no type of its own
    assert question_number(question) == 2


def test_offers_questions_and_progress() -> None:
    assert json.loads(OFFER.to_json()) == {
        "run": "ab" * 16,
        "sender": "cd" * 16,
        "schedule": {"epochs": 1},
        "logs": [{"name": "a"}],
        "robot": {"toml": "x"},
        "messages": 3,
        "window": 7,
        "version": 2,
    }
    plain = Offer(run="ab" * 16, schedule={}, logs=[])
    assert (plain.sender, plain.window, plain.messages) == ("0" * 32, 1, None)
    assert asking(OFFER) == b"cd" * 16
    assert asking(OFFER, farewell=True) == b"farewell " + b"cd" * 16
    assert asker(asking(OFFER)) == asker(asking(OFFER, farewell=True)) == "cd" * 16
    none = {"run": "", "next": 0, "received": 0, "result": None, "error": None}
    assert json.loads(Progress().to_json()) == none  # as version 1 has it
    through = Progress("ab" * 16, 1, 2, {"a": 1}, None, "00" * 32)
    assert json.loads(through.to_json()) == {
        "run": "ab" * 16,
        "next": 1,
        "received": 2,
        "result": {"a": 1},
        "error": None,
        "digest": "00" * 32,
    }
    for progress in (Progress(), through, Progress(error="no")):
        assert Progress.from_json(progress.to_json()) == progress
        assert progress.is_final == (progress != Progress())


LAST = 2**63 - 1
OFFERS: list[tuple[dict[str, Any], str]] = [
    ({}, ""),
    ({"window": 1}, ""),
    ({"window": LAST}, ""),
    ({"messages": None}, ""),
    ({"window": 0}, "expected 32 hexadecimal digits as run and as sender, and a window"),
    ({"window": LAST + 1}, "expected 32 hexadecimal digits as run and as sender, and a window"),
    ({"run": "AB" * 16}, "expected 32 hexadecimal digits as run and as sender, and a window"),
    ({"sender": "cd" * 15}, "expected 32 hexadecimal digits as run and as sender, and a window"),
    ({"version": 1}, "offer: expected protocol version 2, found 1"),
    ({"version": "2"}, "version: found '2', which is of the wrong type"),
    ({"window": True}, "window: found true, which is of the wrong type"),
    ({"logs": None}, "logs: found nothing, which is of the wrong type"),
    ({"more": 1}, "expected an object with run, sender"),
]
PROGRESS: list[tuple[dict[str, Any], str]] = [
    ({}, ""),
    ({"next": 0, "received": 0}, ""),
    ({"next": 1, "received": 1}, ""),
    ({"next": 0, "received": LAST}, ""),
    ({"next": LAST, "received": LAST}, ""),
    ({"digest": "00"}, ""),
    ({"next": -1, "received": 0}, "progress: expected 0 <= next <= received, found -1 and 0"),
    ({"next": 2, "received": 1}, "progress: expected 0 <= next <= received, found 2 and 1"),
    ({"next": 0, "received": LAST + 1}, "progress: expected 0 <= next <= received, found 0 and"),
    ({"next": False}, "next: found false, which is of the wrong type"),
    ({"digest": 3}, "digest: found 3, which is of the wrong type"),
    ({"result": []}, "result: found .*, which is of the wrong type"),
    ({"more": 1}, "expected an object with run, next"),
]


@pytest.mark.parametrize(("change", "complaint"), OFFERS)
def test_what_is_an_offer(change: dict[str, Any], complaint: str) -> None:
    data = json.dumps(json.loads(OFFER.to_json()) | change).encode()
    if complaint:
        with pytest.raises(WireError, match=complaint):
            Offer.from_json(data)
    else:
        assert json.loads(Offer.from_json(data).to_json()) == json.loads(data)


@pytest.mark.parametrize(("change", "complaint"), PROGRESS)
def test_what_is_a_progress(change: dict[str, Any], complaint: str) -> None:
    data = json.dumps(json.loads(Progress("ab" * 16, 1, 2).to_json()) | change).encode()
    if complaint:
        with pytest.raises(WireError, match=complaint):
            Progress.from_json(data)
    else:
        assert json.loads(Progress.from_json(data).to_json()) == json.loads(data)


@pytest.mark.parametrize("data", [b"", b"[]", b"null", b"{}", b"\xff", b"[" * 100_000, b'"run"'])
def test_what_is_no_json_object_of_ours_is_neither(data: bytes) -> None:
    for kind in (Offer, Progress):
        with pytest.raises(WireError, match=r"expected (JSON|an object with run)"):
            kind.from_json(data)
