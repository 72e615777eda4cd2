"""The clock by which messages of a served controller arrive: the one on the wall, or that of `/clock`."""

import time
from collections.abc import Iterator
from contextlib import contextmanager

from recorders.messages.message_types import Clock
from recorders.messages.topics import CLOCK
from recorders.wire.keys.topic_keys import TopicKeys
from recorders.wire.session import Sample, Session
from recorders.wire.sim_time import SimTime

_MAX_CLOCK = 64  # bytes; a message of /clock takes 12


class ArrivalClock:
    """The time at which messages arrive.

    Parameters
    ----------
    use_sim_time : bool
        Whether it is that of `/clock`: a negative one before the first message there.

    Attributes
    ----------
    now_ns : callable
        Returns the time [ns]; any thread may call it.
    """

    def __init__(self, *, use_sim_time: bool) -> None:
        self._sim_time = SimTime() if use_sim_time else None
        self.now_ns = time.time_ns if self._sim_time is None else self._sim_time.time_ns

    @contextmanager
    def running(self, session: Session, keys: TopicKeys) -> Iterator[None]:
        """Follow `/clock` while the block runs, if it is asked for, ahead of anything that arrives later."""
        sim_time = self._sim_time
        if sim_time is None:
            yield
            return

        def take(sample: Sample) -> None:
            """Take a sample of `/clock`, on the thread that reads it."""
            payload = sample.payload
            sim_time.take(payload.to_bytes() if len(payload) <= _MAX_CLOCK else b"")

        with keys.subscribing(session, CLOCK, Clock.TYPE, take, at_once=True):
            yield
