"""Whole copies of files that cannot be read where they are, in a folder that is removed when the program ends."""

import atexit
import os
import shutil
import tempfile
from functools import cache, partial
from itertools import count
from pathlib import Path

from recorders.errors import LogError
from recorders.mcap_format.decompression import DECOMPRESS_ERRORS, SLICE, zstd_frames

_LEAST_LIMIT = 2**31  # bytes that may come out of a file, however short it is
_EXPANSION = 100  # bytes that may come out of a longer one for each of its bytes

_numbers = count()


def unpack_zstd(path: Path) -> Path:
    """Return a decompressed copy of a file; the same one when asked again, as long as the file is as it was.

    Raises
    ------
    LogError
        If it is not zstd, or there is no room for what is in it.
    """
    state = path.stat()
    return _unpacked(path.resolve(), state.st_size, state.st_mtime_ns)


@cache
def _unpacked(path: Path, size: int, _changed_ns: int) -> Path:
    out = new_folder() / path.name.removesuffix(".zstd")
    most = left = max(_LEAST_LIMIT, _EXPANSION * size)
    try:
        with path.open("rb") as packed, out.open("wb") as file:
            for piece in zstd_frames(iter(partial(packed.read, SLICE), b"")):
                left -= len(piece)
                if left < 0:
                    raise LogError(f"{path}: expected at most {most} bytes to come out of it, found more")
                file.write(piece)
    except DECOMPRESS_ERRORS as error:
        raise LogError(f"{path}: expected a sound file compressed with zstd, found none: {error}") from None
    except OSError as error:
        where = tempfile.gettempdir()
        raise LogError(f"{path}: cannot be decompressed into {where} (see TMPDIR): {error.strerror or error}") from None
    return out


def copies(*paths: Path) -> Path:
    """Return a copy of the first file with copies of the others beside it; the same as long as all are as they were.

    Raises
    ------
    LogError
        If there is no room for them.
    """
    states = [(path.resolve(), path.stat()) for path in paths]
    return _copied(tuple((path, state.st_size, state.st_mtime_ns) for path, state in states))


@cache
def _copied(states: tuple[tuple[Path, int, int], ...]) -> Path:
    folder, paths = new_folder(), [path for path, _, _ in states]
    try:
        for path in paths:
            shutil.copyfile(path, folder / path.name)
    except OSError as error:
        where = tempfile.gettempdir()
        raise LogError(f"{paths[0]}: cannot be copied into {where} (see TMPDIR): {error.strerror or error}") from None
    return folder / paths[0].name


def new_folder() -> Path:
    """Return a new folder for copies."""
    folder = _root() / str(next(_numbers))
    folder.mkdir()
    return folder


@cache
def _root() -> Path:
    root, owner = Path(tempfile.mkdtemp(prefix="reenact-")), os.getpid()

    def remove() -> None:
        if os.getpid() == owner:  # not where a forked process ends
            shutil.rmtree(root, ignore_errors=True)

    atexit.register(remove)
    return root
