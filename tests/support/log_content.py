"""Logs of numbered messages, whose bytes name what wrote them."""

from contextlib import suppress
from pathlib import Path

from recorders.errors import LogError
from recorders.reading.reader import LogReader

TOPIC, TYPE = "/numbered", "std_msgs/msg/String"


def payload(run: str, number: int) -> bytes:
    """Return the bytes of a message; some of them are many."""
    return f"{run} {number:6d}".encode() * (1 + number % 40 if number % 50 else 800)


def data_of(path: Path) -> list[bytes]:
    """Return the bytes of the messages of a log before it breaks off."""
    found: list[bytes] = []
    with suppress(LogError):
        for record in LogReader(path):
            found.append(record.data)  # one by one: the last step may raise
    return found


def holds(path: Path, run: str, least: int) -> bool:
    """Whether a log has the first messages of a run, at least so many, and nothing else."""
    found = data_of(path)
    return len(found) >= least and found == [payload(run, number) for number in range(len(found))]


def is_whole(path: Path, run: str, count: int) -> bool:
    """Whether a log is finished and has exactly so many messages of a run."""
    return holds(path, run, count) and len(data_of(path)) == count and LogReader(path).manifest["complete"] is True
