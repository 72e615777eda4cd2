"""The time of `/clock`, by which nodes go that are asked to, in place of the clock on the wall."""

import logging

from recorders.cdr.codec import decode_as
from recorders.errors import MessageError
from recorders.messages.message_types import Clock
from recorders.messages.topics import CLOCK
from recorders.text.once import OnceWarner

logger = logging.getLogger(__name__)


NO_TIME = "before the first message of /clock"
"""Why a message is refused that comes when there is no time."""


class SimTime:
    """Time as the last message of `/clock` stated it; none before the first one. Any thread may ask."""

    def __init__(self) -> None:
        self._now_ns = -1
        self._warnings = OnceWarner(logger, limit=1)

    def take(self, data: bytes) -> None:
        """Take the bytes of a message of `/clock`; one that is none is reported, and changes nothing."""
        try:
            self._now_ns = decode_as(Clock, data).clock_ns
        except MessageError as error:
            self._warnings.warn(f"{CLOCK}: what is no time is passed over: {error}")

    @property
    def is_known(self) -> bool:
        """Whether there is a time."""
        return self._now_ns >= 0

    def time_ns(self) -> int:
        """Return the time [ns]; a negative one before the first message."""
        return self._now_ns
