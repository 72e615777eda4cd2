"""Clocks: when the messages of a stream are due."""

import logging
import threading
import time
from collections.abc import Iterator
from fractions import Fraction
from typing import Protocol

from recorders.errors import ConfigError
from recorders.messages.record import RecordedMessage
from recorders.text.quantities import seconds_text
from recorders.wire.bounded_queue import LONGEST_WAIT_S

logger = logging.getLogger(__name__)

_NS_PER_S = 1_000_000_000
_LONG_WAIT_NS = 60 * _NS_PER_S


class Clock(Protocol):
    """Blocks until a message is due; the times of a stream may jump back where a cycle begins anew."""

    def wait(self, log_time_ns: int) -> None:
        """Return when a message of this time is due."""

    def delay(self, pause_ns: int) -> None:
        """Take note of a pause that was asked for [ns]: all that follows is due that much later."""


class Unpaced:
    """Everything is due at once."""

    def wait(self, log_time_ns: int) -> None:
        """Return at once."""

    def delay(self, pause_ns: int) -> None:
        """Do nothing: everything is still due at once."""


class Paced:
    """Keeps the distances between the messages, divided by a rate; where it cannot, it slips and reports by how much.

    The rate is a ceiling: a stream that is held up goes on from where it is, without hurrying after what it lost.
    A wait of a minute or more is logged: a log whose clock has leapt may ask for years.

    Parameters
    ----------
    rate : float
        1 is real time, 2 twice as fast; from 0.1 to 1000.

    Attributes
    ----------
    slipped_s : float
        How much later than asked for the stream is by now [s].

    Raises
    ------
    ConfigError
        If the rate is out of range.
    """

    def __init__(self, rate: float) -> None:
        if not 0.1 <= rate <= 1000.0:
            raise ConfigError(f"rate: expected 0.1 to 1000, found {rate}")
        self._rate = Fraction(rate)
        self._last_log_ns: int | None = None
        self._due_ns = 0
        self._rest = 0  # what the division by the rate has left over so far
        self.slipped_s = 0.0

    def wait(self, log_time_ns: int) -> None:
        """Wait for the distance to the message before; the first one, and one that jumps back, are due at once."""
        now_ns = time.monotonic_ns()
        if self._last_log_ns is None:
            self._due_ns = now_ns
        else:
            recorded_ns = max(0, log_time_ns - self._last_log_ns)
            apart_ns, self._rest = divmod(recorded_ns * self._rate.denominator + self._rest, self._rate.numerator)
            self._due_ns += apart_ns
            if apart_ns >= _LONG_WAIT_NS:
                gap, wait = seconds_text(recorded_ns), seconds_text(apart_ns // _NS_PER_S * _NS_PER_S)
                logger.info(f"the next message comes in {wait} s: the recording has a gap of {gap} s before it")
        self._last_log_ns = log_time_ns
        if self._due_ns > now_ns:
            while (left_s := (self._due_ns - time.monotonic_ns()) / _NS_PER_S) > 0.0:
                time.sleep(min(left_s, LONGEST_WAIT_S))
        else:
            self.slipped_s += (now_ns - self._due_ns) / _NS_PER_S
            self._due_ns = now_ns

    def delay(self, pause_ns: int) -> None:
        """Move what was due; a pause that was asked for is no slip."""
        self._due_ns += pause_ns


class Pausable:
    """A clock that a person can stop, step and start again; `toggle` and `step` may come from another thread.

    Parameters
    ----------
    clock : Clock
        Paces the stream while it is not stopped.
    """

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._changed = threading.Condition()
        self._stopped = False
        self._steps = 0

    def wait(self, log_time_ns: int) -> None:
        """Wait for the clock, and while stopped for a step."""
        self._clock.wait(log_time_ns)
        self._clock.delay(self._pause())

    def delay(self, pause_ns: int) -> None:
        """Pass it on to the clock."""
        self._clock.delay(pause_ns)

    def _pause(self) -> int:
        """Wait while stopped, and return for how long [ns]."""
        with self._changed:
            if not self._stopped:
                return 0
            began_ns = time.monotonic_ns()
            while self._stopped and self._steps == 0:
                self._changed.wait(LONGEST_WAIT_S)
            if self._stopped:
                self._steps -= 1
        return time.monotonic_ns() - began_ns

    def toggle(self) -> None:
        """Stop, or go on."""
        with self._changed:
            self._stopped, self._steps = not self._stopped, 0
            self._changed.notify_all()

    def step(self) -> None:
        """Let one message pass, and stop."""
        with self._changed:
            self._stopped, self._steps = True, self._steps + 1
            self._changed.notify_all()


def paced(stream: Iterator[RecordedMessage], clock: Clock) -> Iterator[RecordedMessage]:
    """Yield the messages when they are due by the clock."""
    for message in stream:
        clock.wait(message.log_time_ns)
        yield message
