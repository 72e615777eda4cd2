"""A peer that means ill, in a process of its own: publishes and asks everything it can, before and during a replay."""

import random
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import zenoh

from recorders.cdr.codec import encode
from recorders.errors import MessageError
from recorders.messages.message_types import Float64MultiArray, JointState, PoseStamped
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import LEFT_TARGET, RIGHT_TARGET, SAMPLE_JOINTS, SESSION_PHASE, TOPICS
from recorders.protocol.frames import NO_RUN, Frame, FrameType, batch_topic, pack, unpack
from recorders.protocol.stream import Offer, Progress, asking
from recorders.rmw_zenoh.attachment import Attachment
from recorders.rmw_zenoh.names import NodeName
from recorders.wire.keys.namespace import batch_key, control_key
from recorders.wire.keys.ros_keys import RosKeys
from recorders.wire.keys.topic_keys import NamespaceKeys, TopicKeys
from recorders.wire.session import SessionConfig, open_session

NAMESPACE = "reenact"
HUGE = 100 << 20
STRANGER = b"stranger" * 2
OVERHEARD = 200
"""How many packets it keeps."""


@contextmanager
def intruder(endpoint: str, *, domain: int | None = None) -> Iterator[subprocess.Popen[str]]:
    """Start one, in a ROS domain if it is given; it prints `garbage is out`, waits for a stream, and prints `done`."""
    command = [sys.executable, __file__, endpoint, *([] if domain is None else [str(domain)])]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            yield process
        finally:
            process.kill()


def await_word(process: subprocess.Popen[str], word: str) -> None:
    assert process.stdout is not None
    assert process.stdout.readline() == f"{word}\n"


class Intruder:
    """What an ill-meaning peer does. All of it is drawn from one seed."""

    def __init__(self, session: zenoh.Session, keys: TopicKeys) -> None:
        self._session = session
        self._keys = keys
        self._random = random.Random(7)
        self._seen = threading.Event()
        self._stream = Frame(FrameType.MESSAGE, NO_RUN, NO_RUN, 0)
        self._overheard: list[tuple[str, bytes, bytes]] = []

    def listen(self) -> None:
        """Learn run, sender and place of the stream, as anyone can who may subscribe."""

        def note(sample: zenoh.Sample) -> None:
            if sample.attachment is not None and len(self._overheard) < OVERHEARD:
                self._overheard.append((str(sample.key_expr), sample.payload.to_bytes(), sample.attachment.to_bytes()))
            try:
                attachment = None if sample.attachment is None else sample.attachment.to_bytes()
                topic = self._keys.read_key(str(sample.key_expr)).topic
                frame = unpack(topic, b"", self._keys.read_attachment(topic, attachment).ours or b"")
            except MessageError:
                return
            if frame.run != NO_RUN and frame.sender != STRANGER and not self._seen.is_set():
                self._stream = frame
                self._seen.set()

        for key in {f"{NAMESPACE}/**", *self._keys.everything} - {batch_key(NAMESPACE)}:
            self._session.declare_subscriber(key, note)
        self._session.declare_subscriber(control_key(NAMESPACE, "learner", "ack"), note)

    def await_stream(self) -> None:
        assert self._seen.wait(120.0)

    def garbage(self) -> None:
        """Random bytes on every key, with a random attachment or none, and as questions."""
        known = [self._keys.key(topic) for topic in (*TOPICS, batch_topic())]
        keys = [
            *known,
            *(known[0].replace(next(iter(TOPICS)), topic) for topic in ("/no/such/topic", "/escape\x1b[2J")),
        ]
        controls = [control_key(NAMESPACE, "learner", verb) for verb in ("hello", "status", "ack")]
        for key in keys + controls:
            for length in (0, 1, 48, 1_000):
                self._put(key, self._bytes(length))
                self._put(key, self._bytes(length), self._bytes(56))
        for question in (b"", b"farewell", b"farewell " + b"0" * 32, b"{}", self._bytes(1_000), b"[" * 100_000):
            for key in controls[:2]:
                list(self._session.get(key, payload=question, timeout=120.0))

    def wrong_messages(self) -> None:
        """The wrong type on known keys, and another robot's joints, as a live producer sends them and bare."""
        joints = JointState(0, ("antenna", "tail"), np.zeros(2))
        for topic, message in (
            (LEFT_TARGET, joints),
            (RIGHT_TARGET, Float64MultiArray(np.array([1.0]))),
            (SESSION_PHASE, joints),
            (SAMPLE_JOINTS, joints),
        ):
            data = encode(message)
            self._put(self._keys.key(topic), data)
            self._forge(
                Frame(FrameType.MESSAGE, NO_RUN, NO_RUN, 0, (RecordedMessage(topic, message.TYPE, data, 0, 0),))
            )

    def forged_frames(self) -> None:
        """Frames of the run that is under way, of another sender and of its own: past, end, abort, a batch."""
        run, here = self._stream.run, self._stream.first + 1
        past = RecordedMessage(LEFT_TARGET, PoseStamped.TYPE, encode(PoseStamped(0, np.zeros(3))), 0, 0)
        for sender in (STRANGER, self._stream.sender):
            for first in range(here, here + 20):
                self._forge(Frame(FrameType.MESSAGE, run, sender, first, (past,)))
                self._forge(Frame(FrameType.BATCH, run, sender, first, (past, past)))
                self._forge(Frame(FrameType.END, run, sender, first))
                self._forge(Frame(FrameType.ABORT, run, sender, first, reason="forged"))

    def forged_questions(self) -> None:
        """Offers and questions of the sender that is under way, and its farewell."""
        run, sender = self._stream.run.hex(), self._stream.sender.hex()
        offer = Offer(run=run, schedule={}, logs=[], sender=sender)
        for verb, payload in (
            ("hello", offer.to_json()),
            ("hello", Offer(run=run, schedule={}, logs=[], sender="ab" * 16).to_json()),
            ("status", asking(offer)),
            ("status", asking(offer, farewell=True)),
        ):
            for attachment in (None, self._bytes(40)):
                key = control_key(NAMESPACE, "learner", verb)
                list(self._session.get(key, payload=payload, attachment=attachment, timeout=120.0))

    def replay_overheard(self) -> None:
        """Everything that was overheard, once more, and on another key."""
        for key, payload, attachment in tuple(self._overheard):
            self._put(key, payload, attachment)
            self._put(batch_key(NAMESPACE), payload, attachment)

    def forged_answers(self) -> None:
        """Acknowledgements, a result and a failure that the learner never gave."""
        run, key = self._stream.run.hex(), control_key(NAMESPACE, "learner", "ack")
        for forged in (
            Progress(run="f" * 32, next=7, received=7),
            Progress(run=run, next=1 << 40, received=1 << 40),
            Progress(run=run, next=1 << 40, received=1 << 40, result={"digest": "forged"}),
            Progress(run=run, next=self._stream.first, received=self._stream.first, result={"digest": "forged"}),
            Progress(run=run, next=self._stream.first, received=self._stream.first, error="forged"),
        ):
            self._put(key, forged.to_json())
            self._put(key, forged.to_json(), self._bytes(40))

    def huge_message(self) -> None:
        self._put(self._keys.key(SAMPLE_JOINTS), bytes(HUGE))
        list(self._session.get(control_key(NAMESPACE, "learner", "status"), timeout=120.0))  # it is through

    def _forge(self, frame: Frame) -> None:
        payload, attachment = pack(frame)
        single = frame.kind is FrameType.MESSAGE
        key = self._keys.key(frame.messages[0].topic) if single else batch_key(NAMESPACE)
        if single and isinstance(self._keys, RosKeys):
            attachment = Attachment(1, 1, STRANGER).pack() + attachment
        self._put(key, payload, attachment)
        if frame.run != NO_RUN:
            self._put(key, payload, attachment + self._bytes(24))  # as long as a seal

    def _put(self, key: str, payload: bytes, attachment: bytes | None = None) -> None:
        self._session.put(key, payload, attachment=attachment, congestion_control=zenoh.CongestionControl.BLOCK)

    def _bytes(self, length: int) -> bytes:
        return self._random.randbytes(length)


def keys_of(domain: int | None = None) -> TopicKeys:
    """Return the keys of a domain, or those of the namespace."""
    return NamespaceKeys(NAMESPACE) if domain is None else RosKeys(domain, NodeName("intruder"))


def main() -> None:
    with open_session(SessionConfig(connect=(sys.argv[1],))) as session:
        guest = Intruder(session, keys_of(*map(int, sys.argv[2:])))
        guest.garbage()
        guest.listen()
        print("garbage is out", flush=True)
        guest.await_stream()
        guest.garbage()
        guest.wrong_messages()
        for _ in range(5):
            guest.forged_frames()
            guest.forged_answers()
            guest.forged_questions()
            guest.replay_overheard()
        guest.huge_message()
        print("done", flush=True)


if __name__ == "__main__":
    main()
