"""Lines for a verb that a signal cut short: the signal, and the files that the verb leaves behind."""

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

_SIGNALS = {
    128 + signal.SIGINT: "interrupted",
    128 + signal.SIGTERM: "terminated",
    128 + signal.SIGHUP: "its terminal was closed",
}


def exit_line(stop: KeyboardInterrupt | SystemExit) -> tuple[str, int]:
    """Return the last line of a verb that was cut short, and its exit status: 128 and the number of the signal."""
    status = 128 + signal.SIGINT if isinstance(stop, KeyboardInterrupt) else stop.code
    if status not in _SIGNALS:
        status = 128 + signal.SIGTERM
    return "; ".join([_SIGNALS[status], *getattr(stop, "__notes__", ())]), status


@contextmanager
def note_on_interrupt(note: Callable[[], str | None]) -> Iterator[None]:
    """Add a note to the last line if the block is cut short; `note` is called then."""
    try:
        yield
    except (KeyboardInterrupt, SystemExit) as stop:
        if (left := note()) is not None:
            stop.add_note(left)
        raise


@contextmanager
def note_partial_log(out: Path) -> Iterator[None]:
    """Add to the last line where the unfinished log is, if the block began one and is cut short."""
    from recorders.writing.part_file import part_of

    part = part_of(out)
    before = _identity(part)

    def note() -> str | None:
        """Return where the unfinished log is."""
        if _identity(part) in (None, before):
            return None
        example = out.with_name(f"recovered_{out.name}")
        return f"what was recorded until then is in {part}: `reenact recover {part} --out {example}`"

    with note_on_interrupt(note):
        yield


def _identity(path: Path) -> tuple[int, int] | None:
    try:
        found = path.stat()
    except OSError:
        return None
    return found.st_dev, found.st_ino
