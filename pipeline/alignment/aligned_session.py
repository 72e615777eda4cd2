"""The ticks of a recorded session with its phase markers between them, as `reenact convert` writes them."""

from collections import deque
from collections.abc import Iterable, Iterator
from typing import Any

from pipeline.alignment.aligned_log import AlignedLog
from recorders.cdr.rosbags_types import schema_text
from recorders.containers.reader import DelegatingReader
from recorders.mcap_format.channels import DeclaredChannel
from recorders.messages.message_types import String
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import SESSION_PHASE
from recorders.reading.raw_messages import FOREVER_NS

_SCHEDULE = "schedule"


class AlignedSession(DelegatingReader):
    """Reads a log of ticks, and before each tick the markers that came before it.

    A marker has the time of the tick that follows it; those after the last tick come after it.

    Parameters
    ----------
    log : AlignedLog
        The ticks.
    """

    def __init__(self, log: AlignedLog) -> None:
        super().__init__(log)
        self._phases, self._schedule = log.phases, log.source_manifest.get(_SCHEDULE)

    def records(
        self,
        *,
        topics: Iterable[str] | None = None,
        start_ns: int = 0,
        end_ns: int = FOREVER_NS,
        file_order: bool = False,
    ) -> Iterator[RecordedMessage]:
        """Yield the messages: see `AlignedLog.records`."""
        wanted = None if topics is None else frozenset(topics)
        asked = wanted is None or SESSION_PHASE in wanted
        waiting = deque(phase for phase in self._phases if asked and start_ns <= phase.log_time_ns < end_ns)
        for record in super().records(topics=wanted, start_ns=start_ns, end_ns=end_ns, file_order=file_order):
            while waiting and waiting[0].log_time_ns <= record.log_time_ns:
                yield waiting.popleft()
            yield record
        yield from waiting

    @property
    def manifest(self) -> dict[str, Any]:
        """Account of the alignment, and the schedule of the session, if it states one."""
        return super().manifest | ({_SCHEDULE: self._schedule} if isinstance(self._schedule, dict) else {})

    @property
    def topics(self) -> dict[str, str]:
        """The topics of a tick and that of the markers, and their types."""
        return {SESSION_PHASE: String.TYPE, **super().topics}

    @property
    def channels(self) -> tuple[DeclaredChannel, ...]:
        """The channels of these."""
        schema = String.TYPE, "ros2msg", schema_text(String.TYPE).encode()
        return (DeclaredChannel(SESSION_PHASE, "cdr", schema=schema), *super().channels)

    @property
    def counts(self) -> dict[str, int]:
        """The number of messages on each topic."""
        return {SESSION_PHASE: len(self._phases), **super().counts}
