"""Messages of others' encodings and definitions as ours: the same log, with joints, poses and transforms in CDR."""

from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator
from functools import cached_property

from recorders.cdr.codec import decode, encode
from recorders.cdr.message_format import FORMATS
from recorders.cdr.rosbags_types import schema_text
from recorders.containers.decoding import ENCODINGS, Decoding, find_decoding, pose_decoding
from recorders.containers.definitions import is_standard
from recorders.containers.reader import DelegatingReader, Reader
from recorders.containers.ros1_to_cdr import transcoder
from recorders.errors import MessageError, ReenactError
from recorders.mcap_format.channels import DeclaredChannel
from recorders.mcap_format.errors import DamagedLog
from recorders.messages.record import RecordedMessage
from recorders.reading.raw_messages import FOREVER_NS
from recorders.reading.reader import LogReader
from recorders.reading.session_reader import SessionReader


def translated(reader: Reader) -> Reader:
    """Return a reader of the same log whose messages are ours; the same one if they are already."""
    try:
        if isinstance(reader, LogReader | SessionReader) and reader.by_file and not reader.indexed:
            return reader  # our recorder was cut off, and writes nothing else
        return TranslatedReader(reader) if any(map(is_foreign, reader.channels)) else reader
    except DamagedLog:
        return reader  # who reads it meets the damage where it is


def as_poses(reader: Reader, topics: Collection[str]) -> Reader:
    """Return a reader of the same log in which these topics are poses, where they can be: of odometry, transforms..."""
    try:
        poses = [channel.topic for channel in reader.channels if channel.topic in topics and pose_decoding(channel)]
    except DamagedLog:
        return reader
    return TranslatedReader(reader, poses=poses) if poses else reader


class TranslatedReader(DelegatingReader):
    """Reads another reader's log and translates what can be; everything else is as it is.

    Parameters
    ----------
    reader : Reader
        The other one.
    poses : collection of str
        Topics that are to be poses, whatever else they can be.
    """

    def __init__(self, reader: Reader, *, poses: Collection[str] = ()) -> None:
        super().__init__(reader)
        self._poses = frozenset(poses)

    @cached_property
    def _decodings(self) -> dict[str, Decoding | ReenactError]:
        """How topics are translated that are, or why they cannot be."""
        found: dict[str, Decoding | ReenactError] = {}
        for channel in filter(self._is_translated, self._reader.channels):
            try:
                decoding = (pose_decoding if channel.topic in self._poses else find_decoding)(channel)
            except ReenactError as error:
                found[channel.topic] = error
                continue
            if decoding is not None:
                found[channel.topic] = decoding
        return found

    @cached_property
    def _transcoders(self) -> dict[str, Callable[[bytes], bytes | None]]:
        """What makes CDR of topics of ROS 1 without decoding them; of each only if it has one channel."""
        channels = [channel for channel in self._reader.channels if channel.topic not in self._poses]
        found = {channel.topic: transcoder(channel) for channel in channels}
        several = Counter(channel.topic for channel in channels)
        return {topic: fast for topic, fast in found.items() if fast is not None and several[topic] == 1}

    def _is_translated(self, channel: DeclaredChannel) -> bool:
        return channel.topic in self._poses or is_foreign(channel)

    def records(
        self,
        *,
        topics: Iterable[str] | None = None,
        start_ns: int = 0,
        end_ns: int = FOREVER_NS,
        file_order: bool = False,
    ) -> Iterator[RecordedMessage]:
        """Yield the messages: see `recorders.reading.reader.LogReader.records`.

        One that cannot be translated comes with the bytes that it has, which are no message of its type: whoever reads
        it counts or refuses it as any other that is malformed.

        Raises
        ------
        MissingExtra
            If a topic that is asked for by name needs a package that is not installed.
        """
        wanted = None if topics is None else frozenset(topics)
        for topic in sorted(wanted or ()):
            error = self._decodings.get(topic)
            if isinstance(error, ReenactError):
                raise error
        return map(
            self._translate,
            self._reader.records(topics=wanted, start_ns=start_ns, end_ns=end_ns, file_order=file_order),
        )

    def _translate(self, record: RecordedMessage) -> RecordedMessage:
        decoding = self._decodings.get(record.topic)
        if not isinstance(decoding, Decoding):
            return record
        fast = self._transcoders.get(record.topic)
        data = None if fast is None else fast(record.data)
        if data is None:
            try:
                data = encode(decoding.decode(record.data))
            except MessageError:
                data = _unreadable(decoding.type, record.data)
        return RecordedMessage(record.topic, decoding.type, data, record.sequence, record.log_time_ns)

    @property
    def channels(self) -> tuple[DeclaredChannel, ...]:
        """Every channel, those that are translated as ours."""
        return tuple(dict.fromkeys(map(self._declared, self._reader.channels)))

    def _declared(self, channel: DeclaredChannel) -> DeclaredChannel:
        decoding = self._decodings.get(channel.topic)
        if not isinstance(decoding, Decoding) or not self._is_translated(channel):
            return channel
        schema = decoding.type, "ros2msg", schema_text(decoding.type).encode()
        return DeclaredChannel(channel.topic, "cdr", channel.metadata, schema)

    @property
    def topics(self) -> dict[str, str]:
        """The type of each topic, in the order in which they first appeared."""
        types = self._reader.topics
        return {
            topic: found.type if isinstance(found := self._decodings.get(topic), Decoding) else kind
            for topic, kind in types.items()
        }


def _unreadable(type_name: str, data: bytes) -> bytes:
    """Return bytes that are no message of a type: these, or none where they happen to be one in CDR."""
    try:
        decode(type_name, data)
    except MessageError:
        return data
    return b""


def is_foreign(channel: DeclaredChannel) -> bool:
    """Whether messages of a channel are to be translated: of another encoding, or another definition of our type."""
    if channel.encoding not in ("cdr", ""):
        return channel.encoding in ENCODINGS
    try:
        return FORMATS.get(channel.type) is not None and not is_standard(channel)
    except MessageError:
        return True
