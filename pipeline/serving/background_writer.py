"""Writes a node's log, reports its lines and does what else can wait on a thread of its own: no command is delayed."""

import logging
import queue
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Self

from recorders.errors import ReenactError
from recorders.messages.record import RecordedMessage
from recorders.threads import background_thread
from recorders.writing.writer import LogWriter

logger = logging.getLogger(__name__)

UNNUMBERED = -1
"""Sequence of a message that carries no number of its producer's; the log numbers it."""


class BackgroundWriter:
    """Takes records to write, lines to report and work to do, from any thread, while the block of `running` runs.

    A signal, which Python handles on the main thread, cannot cut a record in two. A log that cannot be written any
    longer is given up, and what it is of goes on; the error is raised at the end.

    Parameters
    ----------
    writer : LogWriter or None
        The log, finished as complete if the block ends by itself, by Ctrl-C or by SIGTERM.

    Attributes
    ----------
    written : int
        Messages written so far.
    """

    def __init__(self, writer: LogWriter | None) -> None:
        self._writer = writer
        self._inbox: queue.SimpleQueue[RecordedMessage | str | Callable[[], None] | None] = queue.SimpleQueue()
        self._error: ReenactError | None = None
        self._at_work = False
        self.written = 0

    @contextmanager
    def running(self) -> Iterator[Self]:
        """Write and work while the block runs; at its end finish everything handed in so far, and the log.

        Raises
        ------
        LogError
            At the end of the block, if the log could not be written.
        """
        failed = False
        try:
            with background_thread(
                self._work, name="background writer", stop=lambda: self._inbox.put(None), daemon=False
            ):
                yield self
        except Exception:  # which those of signals are not
            failed = True
            raise
        finally:
            self._finish(failed)

    def _finish(self, failed: bool) -> None:
        """Finish the log, unless a second signal has cut the wait for its thread short: it stays a part, as written."""
        if self._writer is None or self._at_work:
            return
        if self._error is None and not failed:
            self._writer.close()
            return
        self._writer.abort()
        if self._error is not None:
            raise self._error

    @property
    def records(self) -> bool:
        """Whether there is a log to write on."""
        return self._writer is not None and self._error is None

    def write(self, record: RecordedMessage) -> None:
        """Have a record written."""
        self._inbox.put(record)

    def report(self, line: str) -> None:
        """Have a line logged as a warning."""
        self._inbox.put(line)

    def do(self, work: Callable[[], None]) -> None:
        """Have something done that can wait."""
        self._inbox.put(work)

    def flush(self) -> None:
        """Wait until everything handed in so far is done; the thread must be at work."""
        done = threading.Event()
        self.do(done.set)
        done.wait()

    def _work(self) -> None:
        self._at_work = True
        try:
            while (item := self._inbox.get()) is not None:
                if isinstance(item, str):
                    logger.warning(item)
                elif callable(item):
                    item()
                else:
                    self._write(item)
        finally:
            self._at_work = False

    def _write(self, record: RecordedMessage) -> None:
        if self._writer is None or self._error is not None:
            return
        try:
            self._writer.write(
                record.topic,
                record.data,
                log_time_ns=record.log_time_ns,
                sequence=None if record.sequence == UNNUMBERED else record.sequence,
                type_name=record.type,
            )
            self.written += 1
        except ReenactError as error:
            self._error = error
            logger.warning(f"{error}; nothing more is recorded, all else goes on")
