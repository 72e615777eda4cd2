"""Signals where they cut a verb short: the line that ends it says what it leaves behind."""

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from recorders.writing.part_file import part_of

_WORDS = {
    128 + signal.SIGINT: "interrupted",
    128 + signal.SIGTERM: "terminated",
    128 + signal.SIGHUP: "its terminal was closed",
}


def words(stop: KeyboardInterrupt | SystemExit) -> tuple[str, int]:
    """Return the line for what was cut short, and the exit status: 128 and the number of the signal."""
    status = 128 + signal.SIGINT if isinstance(stop, KeyboardInterrupt) else stop.code
    if status not in _WORDS:
        status = 128 + signal.SIGTERM
    return "; ".join([_WORDS[status], *getattr(stop, "__notes__", ())]), status


@contextmanager
def leaving(tell: Callable[[], str | None]) -> Iterator[None]:
    """Have the line that ends a verb say what is left, if the block is cut short; `tell` is asked then."""
    try:
        yield
    except (KeyboardInterrupt, SystemExit) as stop:
        if (left := tell()) is not None:
            stop.add_note(left)
        raise


@contextmanager
def leaving_log(out: Path) -> Iterator[None]:
    """Have that line say where the log is as far as it came, if the block began one."""
    part = part_of(out)
    before = _identity(part)

    def tell() -> str | None:
        if _identity(part) in (None, before):
            return None
        example = out.with_name(f"recovered_{out.name}")
        return f"what was recorded until then is in {part}: `reenact recover {part} --out {example}`"

    with leaving(tell):
        yield


def _identity(path: Path) -> tuple[int, int] | None:
    try:
        found = path.stat()
    except OSError:
        return None
    return found.st_dev, found.st_ino
