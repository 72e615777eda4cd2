"""Controls of a replay: the comparison with a recorded run, and the keyboard."""

import os
import select
import sys
import termios
import threading
import tty
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from recorders.containers.opening import open_log
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import SESSION_PHASE
from recorders.protocol.stream import Offer
from recorders.threads import background_thread
from replay.diff.divergence import guard
from replay.sources.schedule import Schedule
from replay.transports.clock import Pausable
from replay.transports.transport import Source

_POLL_S = 0.1  # how often the keyboard is asked whether the replay is over


class VerifiedSource:
    """A stream that stops at the first message in which it parts from a recorded run.

    Parameters
    ----------
    source : Source
        The stream.
    compare_with : Path
        Log of the run to compare with.
    everything : bool
        Whether all its topics are compared, or only the learner's and the phase markers.
    """

    def __init__(self, source: Source, compare_with: Path, *, everything: bool) -> None:
        self._source = source
        self._recorded = open_log(compare_with)
        self._topics = None if everything else {SESSION_PHASE, *Schedule.from_dict(source.offer().schedule).topics}

    def offer(self) -> Offer:
        """Return the offer of the stream itself."""
        return self._source.offer()

    def stream(self, start: int = 0) -> Iterator[RecordedMessage]:
        """Yield the messages from index `start` on; those before are compared too.

        Raises
        ------
        CheckFailed
            At the message in which the stream and the recorded run part.
        """
        agreed = guard(self._source.stream(), self._recorded.records(topics=self._topics))
        for index, message in enumerate(agreed):
            if index >= start:
                yield message


@contextmanager
def keyboard(clock: Pausable, *, enabled: bool) -> Iterator[None]:
    """While the block runs, let the space bar stop and start the clock, and a full stop let one message pass.

    Only for a process in the foreground of its terminal: one in the background would be stopped for touching it. The
    terminal hands over single keys for as long as the block runs, Ctrl-C interrupts as ever, and afterwards the
    terminal is as it was before, however the block ends.
    """
    descriptor = _standard_input()
    if not (enabled and _in_foreground(descriptor)):
        yield
        return
    leaving = threading.Event()
    before = termios.tcgetattr(descriptor)
    try:
        tty.setcbreak(descriptor, termios.TCSANOW)
        with background_thread(lambda: _obey(clock, descriptor, leaving), name="keyboard", stop=leaving.set):
            yield
    finally:
        _restore(descriptor, before)


def _obey(clock: Pausable, descriptor: int, leaving: threading.Event) -> None:
    while not leaving.is_set():
        if not _in_foreground(descriptor):  # stopped, and sent to the background: the keys are for others now
            leaving.wait(_POLL_S)
            continue
        try:
            typed, _, _ = select.select([descriptor], [], [], _POLL_S)
            key = os.read(descriptor, 1) if typed else None
        except OSError:
            return
        if key == b"":
            return
        if key == b" ":
            clock.toggle()
        elif key == b".":
            clock.step()


def _standard_input() -> int:
    """Return the descriptor of standard input; -1 if it is closed."""
    try:
        return sys.stdin.fileno()
    except (AttributeError, OSError, ValueError):
        return -1


def _in_foreground(descriptor: int) -> bool:
    try:
        return os.tcgetpgrp(descriptor) == os.getpgrp()
    except OSError:  # it is no terminal, or not the one of this process
        return False


def _restore(descriptor: int, attributes: list[int | list[bytes | int]]) -> None:
    """Put the terminal back, unless it is somebody else's by now or gone."""
    if _in_foreground(descriptor):
        termios.tcsetattr(descriptor, termios.TCSANOW, attributes)
