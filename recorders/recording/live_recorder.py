"""The live recorder: whatever is published goes to a log, whoever publishes it."""

import logging
import time
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Any, Self
from uuid import uuid4

from recorders.errors import MessageError, TakenError, WireError
from recorders.mcap_format.channels import DeclaredChannel
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import CLOCK, type_of
from recorders.nodes.status import NodeSource
from recorders.protocol.frames import NO_RUN, Frame, FrameType
from recorders.reading.parts import PART, part_path
from recorders.recording.config import RecordConfig, RecordingStats
from recorders.recording.file_name import recording_names
from recorders.recording.last_numbers import LastNumbers
from recorders.recording.log_clock import LogClock
from recorders.recording.message_checks import decodes, is_standard
from recorders.recording.ros_channels import TOO_MANY_TOKENS, RosChannels
from recorders.rmw_zenoh.bag_channels import has_definition, with_schema
from recorders.text.once import OnceWarner
from recorders.wire.queries import ReceivedOffer
from recorders.wire.receiver import Event, Receiver
from recorders.wire.sim_time import NO_TIME, SimTime
from recorders.wire.subscription import LiveMessage
from recorders.writing.writer import MAX_CHANNELS, LogWriter

logger = logging.getLogger(__name__)

_POLL_S = 0.2
_TOO_MANY = f"one topic more: a log holds no more than {MAX_CHANNELS} channels"
_STOPPED = "the recorder was stopped"
_FAREWELL_WAIT_S = 5.0  # a sender that lives fetches a result within milliseconds


class LiveRecorder:
    """Writes what a receiver delivers; as an awaited consumer it also acknowledges, and so misses nothing.

    The file is there from the beginning; a `with` block that an exception ends before anything was recorded removes it.

    Parameters
    ----------
    out : Path, optional
        Log to write; with a split, `NAME_000.mcap`, `NAME_001.mcap` and so on. `recording.file_name` defines what is
        written without a name, and where parts are that a crash left.
    config : RecordConfig
        What is recorded.
    overwrite : bool
        Whether existing files may be replaced.
    on_progress : callable
        Called with the recording so far, a few times a second.
    clock : callable
        The clock on the wall [ns]; log time goes by it, but never falls.
    ros : RosChannels, optional
        The channels of a ROS domain, for messages of which no sender declares one.

    Attributes
    ----------
    out : Path
        The log, or what its parts are called without their numbers.
    recording : RecordingStats
        What has been recorded so far.

    Raises
    ------
    LogError
        If the first file cannot be made, or one of those that a split may make is there already.
    """

    def __init__(
        self,
        out: Path | None,
        *,
        config: RecordConfig | None = None,
        overwrite: bool = False,
        on_progress: Callable[[RecordingStats], None] = lambda recording: None,
        clock: Callable[[], int] = time.time_ns,
        ros: RosChannels | None = None,
    ) -> None:
        self._config = config or RecordConfig()
        self._overwrite = overwrite
        self._on_progress = on_progress
        self._ros = ros
        self._sim_time = SimTime() if self._config.use_sim_time else None
        self._clock = LogClock(clock) if self._sim_time is None else LogClock(self._sim_time.time_ns, name=CLOCK)
        self._warnings = OnceWarner(logger, limit=1)
        self._streaming = False  # in the middle of a stream that awaits this
        self._ended = False  # one has come to its end, or broken off, and no other has begun
        self._last = LastNumbers()
        self._notes: dict[str, Any] = {}
        self._attachments: dict[str, bytes] = {}
        self.recording = RecordingStats()
        self._splits = self._config.split_bytes is not None or self._config.split_ns is not None
        self._session = uuid4().hex  # names what the parts are parts of
        self._first_ns: int | None = None  # when the file's first message came
        self.out, self._writer = self._begin(out, clock())

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._writer.__exit__(kind, error, trace)

    def run(
        self, receiver: Receiver, *, stopped: Callable[[], bool] = lambda: False, stop_at_stream_end: bool = False
    ) -> RecordingStats:
        """Record until it is stopped, or to the end of a stream, and finish the file.

        What had arrived when it was stopped is recorded too, and the sender of a stream under way informed. The end of
        a stream is when every awaited consumer has reported, so that what they publish at its end is recorded.

        Parameters
        ----------
        receiver : Receiver
            One that receives live messages too.
        stopped : callable
            Whether to stop; asked a few times a second.
        stop_at_stream_end : bool
            Whether the end of an awaited stream ends the recording.

        Raises
        ------
        LogError
            If a file cannot be written; what was written stays readable.
        WireError
            If the stream whose end was to end the recording broke off.
        """
        self.recording.refused = receiver.refused
        try:
            with receiver.reporting_failure():
                while not (stopped() or (self._is_over(receiver) and stop_at_stream_end)):
                    self._take(receiver, _next(receiver))
                    self._writer.check()
                    self._on_progress(self.recording)
                self._take_leave(receiver)
                self._note_publishers()
        finally:
            self._writer.close()
        if stop_at_stream_end and self.recording.broken:
            raise WireError(f"{self.out}: the stream is not all there: {self.recording.broken[-1]}")
        return self.recording

    def _note_publishers(self) -> None:
        """State in the log what came of each publisher, and what did not; count those that nothing is known of."""
        if counts := self.recording.publishers.to_dict():
            self._writer.note(counts)
        if self._ros is not None and (number := self._ros.too_many()):
            self.recording.refused[TOO_MANY_TOKENS] += number

    def source(self, name: str) -> NodeSource:
        """Return the fields of this recorder's status."""
        return NodeSource(
            "recorder",
            name,
            state=lambda: "recording a stream" if self._streaming else "recording",
            counts=self._counts,
        )

    def _counts(self) -> dict[str, int]:
        recording = self.recording
        totals = {"gaps": recording.gaps, "opaque": recording.opaque, "refused": recording.refused}
        return {
            "messages": recording.messages,
            "bytes": recording.size,
            "left_out": recording.left_out,
            "broken": len(recording.broken),
        } | {name: sum(tuple(counted.values())) for name, counted in totals.items()}

    def _is_over(self, receiver: Receiver) -> bool:
        """Whether a stream has ended, and its sender needs no more from here; one that is gone is left."""
        return self._ended and receiver.is_released()

    def _take_leave(self, receiver: Receiver) -> None:
        """Record what has arrived, which is no more than a receiver lets wait, and inform the sender of a stream."""
        receiver.unsubscribe()
        while (event := _next(receiver, 0.0)) is not None:
            if isinstance(event, ReceivedOffer):
                receiver.refuse(event, _STOPPED)
            else:
                self._take(receiver, event)
        if self._streaming:
            self._break_off(_STOPPED)
            receiver.fail(_STOPPED)
        else:
            receiver.is_released(_FAREWELL_WAIT_S)

    def _take(self, receiver: Receiver, event: Event | WireError | None) -> None:
        if isinstance(event, WireError):
            self._leave(receiver, str(event))
        elif isinstance(event, LiveMessage):
            sent = event.record._replace(topic=event.sent_as)
            self._write(event, _declared(receiver, event.run, event.sender, sent))
        elif isinstance(event, ReceivedOffer):
            self._note(event)
            self._streaming, self._ended = True, False
            receiver.accept(event, 0)
        elif isinstance(event, Frame):
            self._take_frame(receiver, event)

    def _take_frame(self, receiver: Receiver, frame: Frame) -> None:
        before = self.recording.messages
        for sent, record in zip(frame.messages, receiver.own_records(frame), strict=True):
            declared = _declared(receiver, frame.run, frame.sender, sent)
            self._write(LiveMessage(record, True, frame.run, frame.sender), declared)
        self.recording.of_streams += self.recording.messages - before
        if frame.kind is FrameType.END:
            self._streaming, self._ended = False, True
            receiver.report(self.recording.totals())
        elif frame.kind is FrameType.ABORT:
            self._leave(receiver, frame.reason)
        else:
            receiver.consumed(frame)

    def _leave(self, receiver: Receiver, reason: str) -> None:
        """Leave a stream whose sender is gone: what it sent is recorded, and others may follow."""
        receiver.abandon_stream(reason)
        self._break_off(reason)

    def _break_off(self, reason: str) -> None:
        self._streaming, self._ended = False, True
        self.recording.broken.append(reason)
        self._notes["broken"] = list(self.recording.broken)
        self._writer.note(self._notes)

    def _note(self, offered: ReceivedOffer) -> None:
        """Store the sender's description of its stream in the log."""
        offer = offered.offer
        self._notes |= {"run": offer.run, "schedule": offer.schedule or None, "logs": offer.logs}
        for key, name in (("toml", "robot.toml"), ("urdf", "robot.urdf")):
            text = offer.robot.get(key)
            if isinstance(text, str) and name not in self._attachments:
                self._attachments[name] = text.encode()
                self._writer.attach(name, self._attachments[name])
        self._writer.note(self._notes)

    def _write(self, message: LiveMessage, declared: DeclaredChannel | None) -> None:
        record, origin = message.record, message.origin
        if self._sim_time is not None and record.topic == CLOCK:
            self._sim_time.take(record.data)
        if not self._config.wants(record.topic):
            self.recording.left_out += 1
            return
        if self._sim_time is not None and not self._sim_time.is_known:
            self.recording.refused[f"all topics: {NO_TIME}"] += 1
            return
        if message.numbered:
            self._count_gap(message)
        if self._is_full(len(record.data)):
            self._next_file()
        if self._first_ns is None:
            self._first_ns = time.monotonic_ns()
        if self._ros is not None and declared is None and record.type:
            kind, declared = record.type, self._graph_channel(self._ros, record, message.type_hash)
        else:
            kind, declared = self._type(record, declared)
        if self._config.for_rosbag2:
            declared = with_schema(record.topic, kind, declared)
        try:
            self._writer.write(
                record.topic,
                record.data,
                log_time_ns=self._clock.now_ns(),
                sequence=record.sequence if message.numbered else None,
                type_name=kind,
                opaque=not kind,
                declared=declared,
                publish_time_ns=None if origin is None else origin.source_time_ns,
            )
        except MessageError:  # everything else has been looked at
            self._refuse_topic()
            return
        self._written += len(record.data)
        if record.topic not in self.recording.topics and len(self.recording.topics) < MAX_CHANNELS:
            self.recording.topics.add(record.topic)
        self.recording.messages += 1
        self.recording.size += len(record.data)

    def _refuse_topic(self) -> None:
        self._warnings.warn(f"refused a message on {_TOO_MANY}")
        self.recording.refused[_TOO_MANY] += 1

    def _graph_channel(self, graph: RosChannels, record: RecordedMessage, type_hash: str) -> DeclaredChannel:
        """Return the channel of a message as its key and the graph state it; bytes of no such type are counted."""
        channel = graph.channel(record, type_hash)
        is_of_type = decodes if record.type == type_of(record.topic) else is_standard
        if not (has_definition(channel) and is_of_type(record.type, record.data)):
            self.recording.opaque[record.topic] += 1
        return channel

    def _type(self, record: RecordedMessage, declared: DeclaredChannel | None) -> tuple[str, DeclaredChannel | None]:
        """Return the type of a message, an empty string if it is unknown, and the channel of another log to take over.

        Messages on our topics are of the topics' types if they decode so, whatever a sender declares.
        """
        expected = type_of(record.topic)
        if expected and decodes(expected, record.data):
            same = declared is not None and (declared.encoding, declared.type) == ("cdr", expected)
            return expected, declared if same else None
        if declared is not None and declared.type not in ("", expected):
            return declared.type, declared
        if not expected and is_standard(record.type, record.data):
            return record.type, None
        self.recording.opaque[record.topic] += 1
        return "", declared

    def _count_gap(self, message: LiveMessage) -> None:
        """Count what is missing before a message of its publisher's: others may publish on its topic too."""
        record, origin = message.record, message.origin
        if origin is None:
            missing = self._last.missing_before(record.topic, message.sender, record.sequence)
        else:
            missing = self.recording.publishers.note(
                record.topic, origin.gid, origin.sequence, node_of=lambda: self._node_of(message, origin.gid)
            )
        if missing:
            self.recording.gaps[record.topic] += missing

    def _node_of(self, message: LiveMessage, gid: bytes) -> str:
        if self._ros is None:
            return ""
        return self._ros.node_of(message.record, gid, message.type_hash, session=message.stamped_by)

    def _is_full(self, more: int) -> bool:
        """Whether a message of so many bytes belongs into another file; there is none without a message."""
        if self._first_ns is None:
            return False
        size, longest_ns = self._config.split_bytes, self._config.split_ns
        too_large = size is not None and self._written + more > size
        return too_large or (longest_ns is not None and time.monotonic_ns() - self._first_ns >= longest_ns)

    def _next_file(self) -> None:
        self._writer.note(self._part(len(self.recording.paths) - 1, more=True))
        self._writer.close()
        self._writer = self._open(self.out)
        if self._notes:
            self._writer.note(self._notes)

    def _begin(self, out: Path | None, now_ns: int) -> tuple[Path, LogWriter]:
        """Open the first file, under the first name that nobody else takes at this moment; returns that name too."""
        names = recording_names(out, splits=self._splits, overwrite=self._overwrite, now_ns=now_ns)
        for name in names:
            try:
                return name, self._open(name)
            except TakenError:
                if name == out:
                    raise
        raise AssertionError("there is always another name")

    def _part(self, number: int, *, more: bool) -> dict[str, Any]:
        """Return the fields of a part's manifest that place it in the session."""
        return {PART: {"session": self._session, "number": number, "more": more}}

    def _open(self, name: Path) -> LogWriter:
        number = len(self.recording.paths)
        path = part_path(name, number) if self._splits else name
        writer = LogWriter(
            path,
            manifest={"kind": "recording", **(self._part(number, more=False) if self._splits else {})},
            attachments=self._attachments,
            overwrite=self._overwrite,
            rechunk=False,
        )
        self.recording.paths.append(path)
        self._written = 0
        self._first_ns = None
        return writer


def _next(receiver: Receiver, timeout_s: float = _POLL_S) -> Event | WireError | None:
    """Return what came next, or why the stream under way is taken for broken off."""
    try:
        return receiver.next_event(timeout_s)
    except WireError as error:
        return error


def _declared(receiver: Receiver, run: bytes, sender: bytes, record: RecordedMessage) -> DeclaredChannel | None:
    """Return the channel of a message as the sender of a replay declared it; live messages are of no run."""
    return None if run == NO_RUN else receiver.channels.find(sender, record.topic, record.type)
