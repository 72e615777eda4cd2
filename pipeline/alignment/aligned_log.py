"""A log of others as a log of ticks: hands and joints on our topics, those of a tick with one stamp."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cached_property
from itertools import islice
from pathlib import Path
from typing import Any

from pipeline.alignment.config import AlignmentConfig
from pipeline.alignment.frames import StaticFrames
from pipeline.alignment.row_store import RowStore
from pipeline.alignment.rows import RowFormat
from pipeline.alignment.sources import TopicChoice
from pipeline.alignment.summary import Extents, Summary
from pipeline.alignment.ticks import MOST_PHASES, Aligner
from pipeline.alignment.track import NEVER
from pipeline.robot.config import TOML_FILE, URDF_FILE, RobotConfig
from pipeline.urdf.description import WORLD, parse_urdf, root_link
from recorders.cdr.rosbags_types import schema_text
from recorders.containers.reader import Reader
from recorders.errors import LogError
from recorders.mcap_format.channels import DeclaredChannel
from recorders.messages.record import RecordedMessage
from recorders.reading.raw_messages import FOREVER_NS
from recorders.writing.writer import LogWriter
from replay.sources.episodes import ALIGNMENT, episode_spans

_BLOCK = 8192  # messages at a time; how many does not enter the result


class AlignedLog:
    """The ticks of a log, as `reenact convert` would write them: a reader like that of any log.

    The log is read once; its ticks are held in memory, or in a file of no name where they are many.

    Parameters
    ----------
    reader : Reader
        The log.
    robot : RobotConfig
        Whose joints and hands are in it.
    config : AlignmentConfig
        What is asked for.
    renames : mapping of str to str
        Our topic names for those that the log uses.
    wanted : sequence of str
        Our names of the topics of a tick.

    Attributes
    ----------
    path : Path or Parts
        The log.
    summary : Summary
        What was used, dropped and left out.
    phases : list of RecordedMessage
        The log's phase markers, each with the time of the tick that follows it, or a time after the last tick.

    Raises
    ------
    LogError
        If the log cannot be read, lacks a topic, or makes no ticks.
    """

    protected = True
    by_file = True

    def __init__(
        self,
        reader: Reader,
        robot: RobotConfig,
        *,
        config: AlignmentConfig,
        renames: Mapping[str, str],
        wanted: Sequence[str],
    ) -> None:
        self._reader, self._robot, self.path = reader, robot, reader.path
        choice = TopicChoice(reader, renames, robot.joints).choose(wanted, config)
        aligner = Aligner(
            choice.sources,
            config,
            period_ns=choice.period_ns,
            pivot=choice.pivot,
            frames=StaticFrames(own_frames(robot)),
        )
        self._format = RowFormat(choice.sources, robot.joints)
        self._store = RowStore(self._format.size)
        extents, cuts, restarts, last_ns = Extents.of(choice.sources), 0, 0, NEVER
        for records in _blocks(reader.records(topics=aligner.topics)):
            for ticks in aligner.feed(records):
                extents.add(ticks)
                cuts += int(ticks.cuts.sum())
                restarts += int(ticks.stamps_ns[0]) <= last_ns
                last_ns = int(ticks.stamps_ns[-1])
                self._store.append(self._format.rows(ticks))
        self.summary = Summary.of(aligner, choice, config, cuts=cuts, restarts=restarts)
        if fault := self.summary.fault(extents):
            raise LogError(f"{self.path}: {fault}")
        if len(aligner.phases) == MOST_PHASES:
            raise LogError(f"{self.path}: expected fewer than {MOST_PHASES} phase markers, found more")
        self.phases = [phase._replace(log_time_ns=self._time_of(place)) for place, phase in aligner.phases]

    def _time_of(self, place: int) -> int:
        """Return the stamp of a tick [ns], a time after the last one for that which would follow it."""
        return self._store.stamp(place) if place < len(self._store) else self._store.stamp(place - 1) + 1

    def __iter__(self) -> Iterator[RecordedMessage]:
        """Yield all messages."""
        return self.records()

    def records(
        self,
        *,
        topics: Iterable[str] | None = None,
        start_ns: int = 0,
        end_ns: int = FOREVER_NS,
        file_order: bool = False,  # there is one order
    ) -> Iterator[RecordedMessage]:
        """Yield the messages of the ticks, hands and then joints; their log times are their stamps."""
        wanted = None if topics is None else frozenset(topics)
        for rows in self._store.rows(start_ns, end_ns):
            for record in self._format.records(rows):
                if wanted is None or record.topic in wanted:
                    yield record

    @property
    def manifest(self) -> dict[str, Any]:
        """Account of the alignment."""
        return {ALIGNMENT: self.summary.to_dict()}

    @property
    def source_manifest(self) -> dict[str, Any]:
        """The manifest of the log itself."""
        return self._reader.manifest

    @property
    def topics(self) -> dict[str, str]:
        """The topics of a tick, and their types."""
        return dict(self._format.topics)

    @property
    def channels(self) -> tuple[DeclaredChannel, ...]:
        """The channels of these."""
        return tuple(
            DeclaredChannel(topic, "cdr", schema=(kind, "ros2msg", schema_text(kind).encode()))
            for topic, kind in self._format.topics.items()
        )

    @property
    def counts(self) -> dict[str, int]:
        """The number of messages on each topic: as many as there are ticks."""
        return dict.fromkeys(self._format.topics, len(self._store))

    @cached_property
    def _attachments(self) -> dict[str, bytes]:
        return {TOML_FILE: self._robot.toml_text.encode(), URDF_FILE: self._robot.urdf_text.encode()}

    @property
    def attachments(self) -> tuple[str, ...]:
        """The names of the robot's files."""
        return tuple(self._attachments)

    def attachment(self, name: str) -> bytes:
        """Return a file of the robot; raises LogError if it is none."""
        if name not in self._attachments:
            raise LogError(f"{self.path}: no attachment {name!r}; there are: {', '.join(self._attachments)}")
        return self._attachments[name]


def write_episodes(log: AlignedLog, folder: Path) -> list[Path]:
    """Write the episodes of a log of ticks, each as a log of ours, and return where they are.

    Parameters
    ----------
    log : AlignedLog
        The log.
    folder : Path
        A folder to make, in which they go.

    Raises
    ------
    LogError
        If one cannot be written.
    """
    folder.mkdir()
    spans = episode_spans(log, tuple(log.topics))
    paths = [folder / f"{log.path.stem}{f'_{number}' if number else ''}.mcap" for number in range(len(spans))]
    attachments = {name: log.attachment(name) for name in log.attachments}
    for path, (start_ns, end_ns) in zip(paths, spans, strict=True):
        with LogWriter(path, manifest=log.manifest, attachments=attachments) as writer:
            for record in log.records(start_ns=start_ns, end_ns=end_ns):
                writer.copy(record)
    return paths


def own_frames(robot: RobotConfig) -> tuple[str, ...]:
    """Return the names by which poses are in the world of a robot."""
    return "", WORLD, root_link(parse_urdf(robot.urdf_text))


def _blocks(records: Iterator[RecordedMessage]) -> Iterator[list[RecordedMessage]]:
    """Yield messages many at a time."""
    while block := list(islice(records, _BLOCK)):
        yield block
