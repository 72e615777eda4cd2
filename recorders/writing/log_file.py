"""Crash-safe log file: flushed promptly, fsynced every second."""

import errno
import os
import threading
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path

from recorders.errors import LogError
from recorders.mcap_format.chunk_contents import MessageColumns
from recorders.writing.chunk_writer import ChunkWriter, rechunk_log
from recorders.writing.part_file import PartFile
from recorders.writing.periodic_thread import PeriodicThread

LOOK_EVERY_S = (
    0.025  # what waits at two looks is written: half of the 100 ms that a crash may cost are for a busy machine
)
SYNC_EVERY_S = 1.0


class LogFile:
    """The chunks of a log in its `.part`, and the two threads that hand them on; nothing follows a failure.

    One thread hands over what has waited for long. The other one syncs, which may take its time.

    Parameters
    ----------
    path : Path
        Where the log goes in the end.
    end : callable
        Writes the last records to the chunks, given whether the log is complete.
    on_chunk : callable, optional
        Given the messages of each chunk that is written.
    overwrite : bool
        Whether files of this name may be replaced.
    rechunk : bool
        Whether a log in which chunks ended early is copied into regular ones.

    Attributes
    ----------
    part : Path
        The file while it is written.
    chunks : ChunkWriter
        What `change` may act on. One thread may have it gather messages without that.
    sound : bool
        Whether the file ends with a whole record, and more may follow; False also while a thread writes.

    Raises
    ------
    LogError
        If the file cannot be made.
    """

    def __init__(
        self,
        path: Path,
        *,
        end: Callable[[ChunkWriter, bool], None],
        on_chunk: Callable[[MessageColumns], None] = lambda messages: None,
        overwrite: bool,
        rechunk: bool,
    ) -> None:
        self._file = PartFile(path, overwrite=overwrite)
        self.part = self._file.part
        try:
            self.chunks = ChunkWriter(self._file.stream, self.part, on_chunk=on_chunk)
        except OSError as error:
            self._file.close(keep=False)
            raise self._file.error(error) from error
        self._end = end
        self._rechunk = rechunk
        self._lock = threading.Lock()
        self.sound = True
        self._closed = False
        # Until there is another:
        self._unreported: LogError | None = self._unwritable("an earlier write was interrupted")
        self._seen: int | None = None  # messages written when the last look found others that wait
        self._threads = (
            PeriodicThread(self._flush_late, name="log flush", every_s=LOOK_EVERY_S),
            PeriodicThread(self._sync, name="log sync", every_s=SYNC_EVERY_S),
        )
        try:
            for thread in self._threads:
                thread.start()
        except BaseException:
            self.abort()
            raise

    def change(self, write: Callable[[], object]) -> None:
        """Call a function that writes whole records.

        Raises
        ------
        LogError
            If it fails, or something has failed before. Cut short by a failure or a signal, it is the last.
        """
        with self._lock:
            self._check()
            self.sound = False
            try:
                write()
            except OSError as error:
                self._unreported = None
                raise self._file.error(error) from error
            self.sound = True

    def check(self) -> None:
        """Raise LogError if nothing can be written any more; why a thread failed is reported once."""
        with self._lock:  # while a thread writes, the file does not end with a whole record
            self._check()

    def _check(self) -> None:
        if self.sound:
            return
        unreported, self._unreported = self._unreported, None
        raise unreported or self._unwritable("the log was closed, or an earlier write failed")

    def close(self) -> None:
        """Finish the log and give it its name; raises LogError if that fails or a thread has failed."""
        if self._closed:
            return
        self._stop()
        with self._lock:
            if self.sound:
                self._complete()
                return
        unreported = self._unreported
        self.abort()
        if unreported is not None:
            raise unreported

    def abort(self) -> None:
        """Finish the log as incomplete, as well as the disk allows, and leave it as `.part`; raises nothing."""
        if self._closed:
            return
        self._stop()
        with self._lock:
            self._closed = True
            self._unreported = None
            if self.sound:
                self._finish(complete=False)
            self.chunks.close()
            self._file.close(keep=self.chunks.messages > 0)

    def _complete(self) -> None:
        self._closed = True
        self.sound = False
        self._unreported = None
        try:
            self._end(self.chunks, True)
            self.chunks.finish()
            if not self._file.is_there():
                raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT))
            if self._rechunk and not self.chunks.regular:
                self._file.rewrite(partial(rechunk_log, path=self.part))
            self._file.publish()
        except (OSError, ValueError) as error:
            raise self._file.failure(error) from error
        finally:
            self.chunks.close()
            self._file.close(keep=True)

    def _finish(self, *, complete: bool) -> None:
        self.sound = False
        with suppress(OSError):  # there is an error already, or an exception under way
            self._end(self.chunks, complete)
            self.chunks.finish()

    def _flush_late(self) -> None:
        """Hand over what waited at the last look and still does."""
        with self._lock:
            seen, self._seen = self._seen, self.chunks.written if self.chunks.pending else None
            if not self.sound or self._seen is None or seen != self._seen:
                return
            self.sound = False
            try:
                self.chunks.flush()
                self.sound = True
            except OSError as error:
                self._unreported = self._file.error(error)

    def _sync(self) -> None:
        """Sync, and see that the file is still there."""
        error: OSError | None = None
        try:
            self._file.sync()
            if self._file.is_there():
                return
        except OSError as met:
            error = met
        with self._lock:
            if self.sound:
                self._finish(complete=False)
                self._unreported = self._file.put_back() if error is None else self._file.error(error)

    def _stop(self) -> None:
        for thread in self._threads:
            thread.stop()

    def _unwritable(self, why: str) -> LogError:
        return LogError(f"cannot write {self.part}: {why}")
