"""The time of `/clock`, by which nodes go that are asked to, in place of the clock on the wall."""

import logging

from recorders.cdr.codec import decode_as
from recorders.errors import MessageError
from recorders.messages.message_types import Clock
from recorders.text.once import OnceWarner

logger = logging.getLogger(__name__)


class SimTime:
    """Time as the last message of `/clock` stated it; none before the first one. Any thread may ask."""

    def __init__(self) -> None:
        self._now_ns: int | None = None
        self._warnings = OnceWarner(logger, limit=1)

    def take(self, data: bytes) -> None:
        """Take the bytes of a message of `/clock`; one that is none is reported, and changes nothing."""
        try:
            self._now_ns = decode_as(Clock, data).clock_ns
        except MessageError as error:
            self._warnings.warn(f"/clock: what is no time is passed over: {error}")

    def now_ns(self) -> int | None:
        """Return the time [ns]; None before the first message."""
        return self._now_ns
