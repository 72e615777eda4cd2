"""What is in a log that somebody writes at the moment, or that came to no end."""

from contextlib import suppress
from pathlib import Path

from recorders.errors import LogError
from recorders.messages.record import RecordedMessage
from recorders.reading.reader import LogReader


def so_far(path: Path) -> list[RecordedMessage]:
    """Return the messages of a log, as far as it is whole; none if there is no such file."""
    found: list[RecordedMessage] = []
    with suppress(LogError):
        for record in LogReader(path):
            found.append(record)  # one by one: the last step may raise
    return found
