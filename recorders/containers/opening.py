"""`open_log`, behind which every log opens."""

from pathlib import Path

from recorders.containers.reader import Reader
from recorders.reading.parts import Log, find_log
from recorders.reading.session_reader import open_mcap


def open_log(log: Log) -> Reader:
    """Return what reads a recording: a log, or a session's parts, named one by one, by their folder or by their stem.

    Raises
    ------
    LogError
        If there is none, or it is none that can be read; see `recorders.reading.parts.find_log`.
    """
    return open_mcap(find_log(log) if isinstance(log, Path) else log)
