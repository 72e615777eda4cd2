"""A disk that fails at one of the calls that are made of it: for one test, on real files."""

import errno
import fcntl
import io
import os
from collections.abc import Callable
from typing import Any

import pytest

CALLS = ("open", "fsync", "link", "unlink", "replace", "rename", "lseek", "pread", "fstat")


class FailingDisk:
    """Counts what is asked of the operating system, and has one call fail.

    Parameters
    ----------
    patch : MonkeyPatch
        Undoes it all.
    fails_at : int
        Which call fails, counted from 0; a negative one: none.
    code : int
        What it fails with.

    Attributes
    ----------
    calls : list of str
        What was asked so far.
    """

    def __init__(self, patch: pytest.MonkeyPatch, fails_at: int = -1, code: int = errno.EIO) -> None:
        self.calls: list[str] = []
        self._fails_at = fails_at
        self._code = code
        for name in CALLS:
            patch.setattr(os, name, self._failing(name, getattr(os, name)))
        patch.setattr(fcntl, "flock", self._failing("flock", fcntl.flock))
        patch.setattr(os, "fdopen", self._fdopen)

    def met(self, name: str) -> None:
        """Note a call; raises OSError if it is the one that fails."""
        self.calls.append(name)
        if len(self.calls) - 1 == self._fails_at:
            raise OSError(self._code, os.strerror(self._code))

    def _failing(self, name: str, act: Callable[..., Any]) -> Callable[..., Any]:
        def failing(*arguments: Any, **options: Any) -> Any:
            self.met(name)
            return act(*arguments, **options)

        return failing

    def _fdopen(self, descriptor: int, mode: str) -> io.BufferedWriter:
        return io.BufferedWriter(_FailingFile(self, descriptor, mode))


class _FailingFile(io.FileIO):
    def __init__(self, disk: FailingDisk, descriptor: int, mode: str) -> None:
        super().__init__(descriptor, mode)
        self._disk = disk

    def write(self, data: Any) -> int:
        self._disk.met("write")
        return super().write(data)

    def tell(self) -> int:
        self._disk.met("tell")
        return super().tell()

    def close(self) -> None:
        """Close, and only then fail: a descriptor is gone whatever `close` says."""
        was_open = not self.closed
        super().close()
        if was_open:
            self._disk.met("close")
