"""Alignment of messages as they arrive: the ticks that a recording of them has, as soon as each is complete."""

import logging
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from pipeline.alignment.aligned_log import own_frames
from pipeline.alignment.blocks import Dropped, joints_kind, pose_kind
from pipeline.alignment.config import DEFAULT_PERIOD_NS, AlignmentConfig
from pipeline.alignment.frames import StaticFrames
from pipeline.alignment.rows import RowFormat
from pipeline.alignment.summary import unknown_frame
from pipeline.alignment.ticks import Aligner, Source
from pipeline.alignment.track import NEVER
from pipeline.robot.config import RobotConfig
from recorders.cdr.codec import stamp_ns
from recorders.errors import ConfigError, MessageError
from recorders.messages.message_types import JointState, String, TFMessage
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import JOINT_STATES, SESSION_PHASE, TF_STATIC, is_target, type_of
from recorders.text.wording import escape_control, names_text
from replay.sources.episodes import ALIGNMENT
from replay.sources.live import LiveStream
from replay.sources.scheduled import typed

logger = logging.getLogger(__name__)

_MOST_WAITING = 512  # messages; they are aligned together, which changes nothing


class LiveAligner:
    """Aligns messages of a robot.

    Topics that are not renamed to one of a tick are taken to be called as ours are, and joints `/joint_states`.

    Parameters
    ----------
    robot : RobotConfig
        Whose joints and hands they are.
    config : AlignmentConfig
        What is asked for.
    renames : mapping of str to str
        Our topic names for those that are published.
    tick : sequence of str
        Our names of the topics of a tick.

    Attributes
    ----------
    types : dict of str to str
        Types of the topics whose messages are wanted, by the names that they are published under.

    Raises
    ------
    ConfigError
        If the topic of the ticks is none of these.
    """

    def __init__(
        self, robot: RobotConfig, config: AlignmentConfig, *, renames: Mapping[str, str], tick: Sequence[str]
    ) -> None:
        foreign = {ours: name for name, ours in renames.items()}
        sources = [
            Source(foreign.get(ours, JOINT_STATES), ours, joints_kind(robot.joints))
            if type_of(ours) == JointState.TYPE
            else Source(foreign.get(ours, ours), ours, pose_kind())
            for ours in tick
        ]
        pivot = _pivot(sources, config)
        self._period_ns = config.period_ns
        if pivot is None:
            self._period_ns, pivot = config.period_ns or DEFAULT_PERIOD_NS, len(sources) - 1
        self._aligner = Aligner(
            sources, config, period_ns=self._period_ns, pivot=pivot, frames=StaticFrames(own_frames(robot))
        )
        self._format = RowFormat(sources, robot.joints)
        self._config, self._pivot = config, sources[pivot].topic
        self._waiting: list[RecordedMessage] = []
        self._warned = set[str]()  # topics
        self.types = {source.topic: source.kind.message.TYPE for source in sources} | {TF_STATIC: TFMessage.TYPE}
        self.begin()

    @property
    def account(self) -> dict[str, Any]:
        """Settings and topics, for JSON."""
        topics = {source.topic: {"as": source.ours} for source in self._aligner.sources}
        at = {"ticks_of": self._pivot} if self._period_ns is None else {"period_ns": self._period_ns}
        return {**self._config.to_dict(), **at, "topics": topics}

    @property
    def counts(self) -> dict[str, int]:
        """Ticks made and missed so far, and messages dropped."""
        dropped = sum(counts.dropped.total() for counts in self._aligner.counts)
        return {"aligned": self._aligner.made, "missed": self._aligner.missed, "unaligned": dropped}

    def begin(self) -> None:
        """Begin a cycle: stamps start anew."""
        self._waiting.clear()
        self._aligner.begin()
        self._latest_ns = dict.fromkeys((source.topic for source in self._aligner.sources), NEVER)
        self._due_ns: int | None = None

    def feed(self, record: RecordedMessage) -> list[RecordedMessage]:
        """Take in a message and return those of the ticks that it completes; on other topics it is passed over."""
        if record.topic not in self.types:
            return []
        self._waiting.append(record)
        rises = True
        if record.topic in self._latest_ns:
            stamp = self._stamp(record)
            rises = stamp > self._latest_ns[record.topic]
            self._latest_ns[record.topic] = max(self._latest_ns[record.topic], stamp)
            if self._due_ns is None and record.topic == self._pivot:
                self._due_ns = stamp
        if len(self._waiting) < _MOST_WAITING and rises and not self._is_due():
            return []
        restarts = self._aligner.restarts
        found = self._aligner.feed(self._waiting)
        self._waiting.clear()
        self._warn()
        if self._aligner.restarts > restarts:
            self._latest_ns = dict.fromkeys(self._latest_ns, NEVER)
        self._due_ns = self._aligner.next_ns
        return [message for ticks in found for message in self._format.records(self._format.rows(ticks))]

    def _warn(self) -> None:
        """Report, once a topic, that poses are in a frame that is not known."""
        for source, counts in zip(self._aligner.sources, self._aligner.counts, strict=True):
            if source.topic not in self._warned and counts.dropped[Dropped.UNKNOWN_FRAME]:
                self._warned.add(source.topic)
                logger.warning(escape_control(unknown_frame(source, counts)))

    def _is_due(self) -> bool:
        """Whether a tick may be complete: what is sure is found out by the aligner."""
        return self._due_ns is not None and min(self._latest_ns.values()) >= self._due_ns

    def _stamp(self, record: RecordedMessage) -> int:
        """Return the time that a message is of [ns], as far as its first bytes say."""
        stamp: int | None = record.log_time_ns
        if not self._config.by_log_time:
            try:
                stamp = stamp_ns(JointState.TYPE, record.data)
            except MessageError:
                stamp = None
        return NEVER if stamp is None else stamp - self._config.latencies_ns.get(record.topic, 0)


class LiveInputs:
    """Messages as a learner or a controller takes them: renamed, and aligned if that is asked for.

    Parameters
    ----------
    robot : RobotConfig
        Whose joints and hands they are.
    config : AlignmentConfig, optional
        How they are aligned; if left out they are not.
    renames : mapping of str to str
        Our topic names for those that are published.
    tick : sequence of str
        Our names of the topics of a tick.

    Attributes
    ----------
    types : dict of str to str
        Types of the topics whose messages are wanted, by the names that they are published under.
    """

    def __init__(
        self,
        robot: RobotConfig,
        config: AlignmentConfig | None,
        *,
        renames: Mapping[str, str],
        tick: Sequence[str],
    ) -> None:
        self._renames = dict(renames)
        self._aligner = None if config is None else LiveAligner(robot, config, renames=renames, tick=tick)
        replaced = set(renames.values())
        named = (*renames, *(topic for topic in tick if topic not in replaced))
        types = {topic: type_of(renames.get(topic, topic)) for topic in named}
        self.types = {SESSION_PHASE: String.TYPE} | (types if self._aligner is None else self._aligner.types)

    @property
    def topics(self) -> frozenset[str]:
        """Topics whose messages are wanted."""
        return frozenset(self.types)

    @property
    def account(self) -> list[dict[str, Any]]:
        """How messages are aligned, as an offer and a controller have it; empty if they are not."""
        if self._aligner is None:
            return []
        return [{"name": "live", ALIGNMENT: self._aligner.account}]

    @property
    def counts(self) -> dict[str, int]:
        """Ticks made and missed by an alignment so far, and messages that it dropped; empty without one."""
        return {} if self._aligner is None else self._aligner.counts

    def feed(self, record: RecordedMessage, *, numbered: bool) -> Iterator[tuple[RecordedMessage, bool]]:
        """Yield what comes of a message, each with whether its number is its producer's."""
        if self._aligner is None or record.topic == SESSION_PHASE:
            if self._aligner is not None:
                self._aligner.begin()
            topic = self._renames.get(record.topic, record.topic)
            yield record if topic == record.topic else typed(record._replace(topic=topic)), numbered
            return
        for made in self._aligner.feed(record):
            yield made, True


class AlignedStream(LiveStream):
    """A live stream of messages that are renamed and aligned before.

    Parameters
    ----------
    inputs : LiveInputs
        Renames and aligns them.
    **settings
        Those of a `LiveStream`.

    Attributes
    ----------
    inputs : LiveInputs
        The same.
    """

    def __init__(self, inputs: LiveInputs, **settings: Any) -> None:
        super().__init__(**settings)
        self.inputs = inputs

    def feed(self, record: RecordedMessage, *, numbered: bool = True) -> tuple[RecordedMessage, ...]:
        """Take in a message and return what of the stream goes on with it."""
        feed = super().feed
        taken = self.inputs.feed(record, numbered=numbered)
        return tuple(out for made, known in taken for out in feed(made, numbered=known))


def _pivot(sources: Sequence[Source], config: AlignmentConfig) -> int | None:
    """Return the place of the source whose stamps are the ticks, None if there is none."""
    if config.ticks_of is not None:
        for rank, source in enumerate(sources):
            if config.ticks_of in (source.topic, source.ours):
                return rank
        topics = names_text(source.topic for source in sources)
        raise ConfigError(f"--ticks-of: expected one of {topics}, found {config.ticks_of}")
    if config.period_ns is not None:
        return None
    hands = [rank for rank, source in enumerate(sources) if source.turns]
    return next((rank for rank in hands if is_target(sources[rank].ours)), hands[0] if hands else None)
