"""Turns live messages of any publisher into a stream for a learner: phase markers, and complete ticks after them."""

import hashlib
import logging
from collections import Counter, deque
from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import pairwise

from recorders.cdr.codec import decode_as, encode
from recorders.containers.opening import open_log
from recorders.containers.reader import Opened
from recorders.errors import LogError, MessageError
from recorders.messages.message_types import String
from recorders.messages.phase import LEARN, Phase
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import COMMANDED_TICK, SESSION_PHASE
from recorders.protocol.stream import Offer
from recorders.text.wording import escape_control
from recorders.ticks.joiner import NO_POSES, Check, PoseReader, pass_all
from recorders.ticks.live import MAX_MESSAGE, LiveTick, LiveTicks
from recorders.ticks.stamp_joiner import RejectionError
from replay.sources.schedule import Schedule
from replay.sources.scheduled import read_robot, renamed

logger = logging.getLogger(__name__)

LIVE_RUN = hashlib.sha256(b"live").hexdigest()[:32]
"""Names a run to which nobody has given a name with a phase marker."""

_NO_RENAMES: Mapping[str, str] = {}


class LiveStream:
    """Passes on what a learner can take, and refuses the rest with a line; a refused message changes nothing.

    Ticks that come before any marker are for learning, in epoch 0. Markers are followed: the first names the run, and
    those of other runs are followed under that name. Where a tick is missing, the marker is repeated before the next
    one: no tick is ever paired with one that is not its successor.

    What is refused and missing is logged: the first time for each reason, the 10th, the 100th.

    Parameters
    ----------
    epochs : int
        Epochs of the run, over which the rates fall; markers of later ones are refused.
    check : callable
        What else is asked of a position or of joints.
    tick : tuple of str
        Topics that a tick has a message of each.
    poses : mapping of str to callable
        Readers of the topics of hands whose pose is controlled.
    phase : Phase, optional
        Where the learner that takes the stream stands already.
    quiet : bool
        Whether nothing is logged, as for a stream that has been seen before.

    Attributes
    ----------
    quiet : bool
        Whether nothing is logged from now on.
    topics : frozenset of str
        Topics of the stream: those of a tick, and of phase markers.
    refused : counter of str
        How many messages were refused, by topic and reason.
    gaps : int
        How many times ticks were missing between two others.
    ticks : int
        Ticks passed on.
    steps : int
        How many of them follow upon another, and so make a step.
    """

    def __init__(
        self,
        *,
        epochs: int = 1,
        check: Check = pass_all,
        tick: tuple[str, ...] = COMMANDED_TICK,
        poses: Mapping[str, PoseReader] = NO_POSES,
        phase: Phase | None = None,
        quiet: bool = False,
    ) -> None:
        self._epochs = epochs
        self._phase = phase
        self.quiet = quiet
        self._marked = False  # whether the marker in force has been passed on
        self._joiner = LiveTicks(check, tick, poses)
        self.topics = frozenset({SESSION_PHASE, *tick})
        self._arrived: Counter[str] = Counter()
        self._repeats = 0
        self._follows = False  # whether a tick was passed on since the marker in force was
        self._first_refusal = ""
        self.refused: Counter[str] = Counter()
        self.gaps = 0
        self.ticks = 0
        self.steps = 0

    @property
    def run(self) -> str:
        """Name of the run."""
        return LIVE_RUN if self._phase is None else self._phase.run

    @property
    def dropped(self) -> int:
        """Ticks that were given up, as messages of theirs never came."""
        return self._joiner.dropped

    @property
    def losses(self) -> str:
        """Refused and missing messages, with the first reason, as the end of a line; empty if there were none."""
        counts = {"refused": self.refused.total(), "given up": self.dropped, "gaps": self.gaps}
        text = ", ".join(f"{name} {count}" for name, count in counts.items() if count)
        first = f"; the first: {self._first_refusal}" if self._first_refusal else ""
        return f"; {text}{first}" if text else ""

    def feed(self, record: RecordedMessage, *, numbered: bool = True) -> tuple[RecordedMessage, ...]:
        """Take in a message and return what of the stream goes on with it; messages on other topics are passed over.

        Parameters
        ----------
        record : RecordedMessage
            The message.
        numbered : bool
            Whether its sequence is its producer's; the others are numbered here, as a recorder numbers them.
        """
        if record.topic not in self.topics:
            return ()
        if not numbered:
            record = record._replace(sequence=self._arrived[record.topic])
            self._arrived[record.topic] += 1
        try:
            if record.topic == SESSION_PHASE:
                return (self._follow(record),)
            tick = self._joiner.feed(record, numbered=numbered)
        except RejectionError as error:
            self.refuse(record.topic, error.kind, str(error))
            return ()
        return () if tick is None else self._pass_on(tick)

    def finish(self) -> None:
        """End the stream: ticks that wait are given up."""
        self._joiner.begin()

    def refuse(self, topic: str, kind: str, line: str) -> None:
        """Count a message that is not taken, and report it if it is time to."""
        reason = f"{topic}: {kind}"
        self._first_refusal = self._first_refusal or escape_control(line)
        self.refused[reason] += 1
        self._report_sometimes(f"refused, {kind}: {line}", self.refused[reason])

    def _follow(self, record: RecordedMessage) -> RecordedMessage:
        """Begin a new cycle with a marker."""
        phase = _parse(record)
        if phase.epoch >= self._epochs:
            raise RejectionError(
                "marker",
                f"{record.topic} #{record.sequence}: expected an epoch below {self._epochs}, found {phase.epoch}; "
                "give their number with --epochs",
            )
        if self._phase is not None and phase.run != self._phase.run:
            phase = replace(phase, run=self._phase.run)
            record = record._replace(data=encode(phase.to_message()))
        self._phase, self._marked, self._follows = phase, True, False
        self._joiner.begin()
        return record

    def _pass_on(self, tick: LiveTick) -> tuple[RecordedMessage, ...]:
        self.ticks += 1
        if tick.after_gap:
            self.gaps += 1
            self._report_sometimes(
                f"ticks are missing before the one at {tick.stamp_ns} ns: it is not paired with the one before",
                self.gaps,
            )
        follows, self._follows = self._follows and not tick.after_gap, True
        self.steps += follows
        if self._marked and not tick.after_gap:
            return tick.records
        return self._marker(tick), *tick.records

    def _marker(self, tick: LiveTick) -> RecordedMessage:
        """Return the marker in force, to be repeated before a tick."""
        if self._phase is None:
            self._phase = Phase(LIVE_RUN, 0, 0, LEARN, log="")
        self._marked = True
        self._repeats += 1
        data = encode(self._phase.to_message())
        return RecordedMessage(SESSION_PHASE, String.TYPE, data, self._repeats - 1, tick.records[0].log_time_ns)

    def _report_sometimes(self, line: str, count: int) -> None:
        if not self.quiet and str(count).strip("0") == "1":
            line = escape_control(line)
            logger.warning(line if count == 1 else f"{line} ({count} times so far)")


class LiveLog:
    """A log as a live stream: the same as that of a learner which received the same messages live.

    It goes by the order of the file, which is that of arrival. What is refused and missing is logged once.

    Parameters
    ----------
    path : Path, Parts or Reader
        A recording, by whomever, with phase markers or without.
    epochs : int
        Epochs of the run.
    check : callable
        What else is asked of a position or of joints.
    tick : tuple of str
        Topics that a tick has a message of each, by our names.
    poses : mapping of str to callable
        Readers of the topics of hands whose pose is controlled.
    renames : mapping of str to str
        Our topic names for those that the log uses.

    Raises
    ------
    LogError
        If the log cannot be read, holds no message for a learner, or has fewer steps in the order of the file than in
        that of log time.
    """

    def __init__(
        self,
        path: Opened,
        *,
        epochs: int = 1,
        check: Check = pass_all,
        tick: tuple[str, ...] = COMMANDED_TICK,
        poses: Mapping[str, PoseReader] = NO_POSES,
        renames: Mapping[str, str] = _NO_RENAMES,
    ) -> None:
        self._reader = open_log(path)
        self.path = self._reader.path
        self._renames = dict(renames)
        self._epochs = epochs
        self._check = check
        self._tick = tick
        self._poses = poses
        self._robot = read_robot(self._reader)
        self._check_order()
        counted = self._new_stream(quiet=False)
        self._count = sum(1 for _ in self._stream(counted))
        self._run = counted.run
        if counted.steps == 0:
            found = f"{counted.ticks} of them{counted.losses}" if counted.ticks else f"none{counted.losses}"
            raise LogError(
                f"{path}: expected complete ticks on {', '.join(tick)} that follow upon one another, found {found}; "
                "see `reenact info`"
            )

    def offer(self) -> Offer:
        """Return the offer that the consumers get before the first message."""
        return live_offer(
            self._run,
            epochs=self._epochs,
            robot=self._robot,
            tick=self._tick,
            messages=self._count,
            log=self.path.name,
        )

    def stream(self, start: int = 0) -> Iterator[RecordedMessage]:
        """Yield the messages from index `start` on."""
        for index, record in enumerate(self._stream(self._new_stream())):
            if index >= start:
                yield record

    def _new_stream(self, *, quiet: bool = True) -> LiveStream:
        return LiveStream(epochs=self._epochs, check=self._check, tick=self._tick, poses=self._poses, quiet=quiet)

    def _check_order(self) -> None:
        """Refuse a log whose chunks lie in another order than they were recorded in."""
        if not self._falls():
            return
        by_file, by_time = self._new_stream(), self._new_stream()
        deque(self._stream(by_file), maxlen=0)
        deque(self._stream(by_time, file_order=False), maxlen=0)
        if by_time.steps > by_file.steps:
            raise LogError(
                f"{self.path}: --as-live goes by the order of the file, and log times fall in it: expected the "
                f"{by_time.steps} steps that there are by log time, found {by_file.steps}; train without --as-live"
            )

    def _falls(self) -> bool:
        """Whether the log times of the messages for a learner fall in the order of the file."""
        records = renamed(self._reader, self._renames, self._new_stream().topics, file_order=True)
        return any(after.log_time_ns < before.log_time_ns for before, after in pairwise(records))

    def _stream(self, live: LiveStream, *, file_order: bool = True) -> Iterator[RecordedMessage]:
        for record in renamed(self._reader, self._renames, live.topics, file_order=file_order):
            yield from live.feed(record)
        live.finish()


def live_offer(
    run: str,
    *,
    epochs: int,
    robot: Mapping[str, str],
    tick: tuple[str, ...] = COMMANDED_TICK,
    messages: int | None = None,
    log: str | None = None,
) -> Offer:
    """Return the offer of a live stream, or of the log of one."""
    return Offer(
        run=run,
        schedule=Schedule(epochs, ((LEARN, 1),), tick).to_dict(),
        logs=[] if log is None else [{"name": log}],
        robot=dict(robot),
        messages=messages,
    )


def _parse(record: RecordedMessage) -> Phase:
    if len(record.data) > MAX_MESSAGE:
        raise RejectionError("too large", f"{record.topic} #{record.sequence}: {len(record.data)} bytes")
    try:
        if record.type != String.TYPE:
            raise MessageError(f"expected {String.TYPE}, found {record.type[:80]!r}")
        return Phase.from_message(decode_as(String, record.data))
    except MessageError as error:
        raise RejectionError("marker", f"{record.topic} #{record.sequence}: {error}") from None
