"""Consumers of a simulated stream: a learner with checkpoints, and a recorder with a log that it syncs."""

from collections.abc import Callable
from typing import Any

from recorders.errors import ReenactError
from recorders.messages.record import RecordedMessage
from recorders.protocol.stream import Offer
from recorders.recording.log_clock import LogClock
from replay.sources.stream_digest import StreamDigest
from simulation.scenario import ConsumerPlan
from simulation.world import BrokenPromiseError


class DiskFullError(ReenactError):
    """The simulated disk takes nothing more."""


class Source:
    """The stream as it really is.

    Attributes
    ----------
    digests, sizes : list of str, list of int
        The digest of the stream up to each index, and its size [bytes].
    """

    def __init__(self, run: str, messages: list[RecordedMessage]) -> None:
        self.run = run
        self.messages = messages
        digest = StreamDigest()
        self.digests, self.sizes = [digest.hexdigest()], [0]
        for message in messages:
            digest.update((message,))
            self.digests.append(digest.hexdigest())
            self.sizes.append(self.sizes[-1] + len(message.data))


class SimulatedConsumer:
    """Takes messages, and keeps what it has of them where a kill does not reach it.

    Attributes
    ----------
    next : int
        Stream index of the message that is awaited.
    durable : int
        Up to which index the stream is durable.
    had : dict of str to int
        Up to which index this consumer has ever had the stream of a sender, killed or not.
    disk_full : bool
        Whether the disk takes nothing.
    """

    def __init__(self, plan: ConsumerPlan, source: Source, wall_clock: Callable[[], int]) -> None:
        self.plan = plan
        self.disk_full = False
        self.next = self.durable = 0
        self.had: dict[str, int] = {}
        self._sender = ""
        self._log_clock = LogClock(wall_clock)
        self._log_time_ns = 0
        self._source = source
        self._digest = StreamDigest()
        self._durable_digest = self._digest.value

    def start(self, offer: Offer) -> int:
        """Return the index from which the stream of an offer is wanted."""
        if offer.run != self._source.run:
            raise BrokenPromiseError("no forged offer is taken", f"{self.plan.name} is asked to take run {offer.run}")
        if self.plan.kind == "recorder":  # a log of its own for each stream
            self.durable, self._durable_digest = 0, StreamDigest().value
        self.next, self._digest = self.durable, StreamDigest(self._durable_digest)
        self._sender = offer.sender
        self.had[offer.sender] = max(self.had.get(offer.sender, 0), self.next)
        return self.next

    def take(self, message: RecordedMessage) -> None:
        """Consume the next message, and check that it is the one."""
        index, messages = self.next, self._source.messages
        if index >= len(messages) or message != messages[index]:
            kind = "no forged message is consumed"
            if message in messages:
                kind = "in order and exactly once"
            raise BrokenPromiseError(kind, f"{self.plan.name} is given {message} where message {index} is due")
        if self.disk_full and self.plan.kind == "recorder":
            raise DiskFullError(f"{self.plan.name}: the disk is full")
        self._digest.update((message,))
        self.next += 1
        self.had[self._sender] = max(self.had[self._sender], self.next)
        self._note_log_time()
        if self.next % self.plan.durable_every == 0:
            self.save()

    def _note_log_time(self) -> None:
        log_time_ns = self._log_clock.now_ns()
        if log_time_ns < self._log_time_ns:
            raise BrokenPromiseError("log time never falls", f"{log_time_ns} ns after {self._log_time_ns} ns")
        self._log_time_ns = log_time_ns

    def save(self) -> None:
        """Make durable what was consumed: a checkpoint, or a sync of the log."""
        if self.disk_full:
            raise DiskFullError(f"{self.plan.name}: the disk is full")
        self.durable, self._durable_digest = self.next, self._digest.value

    def result(self) -> dict[str, Any]:
        """Return what comes of the whole stream."""
        if self.next != len(self._source.messages):
            raise BrokenPromiseError(
                "nothing is silently short",
                f"{self.plan.name} is at its end after {self.next} of {len(self._source.messages)} messages",
            )
        self.save()
        return {"messages": self.next, "digest": self._digest.hexdigest()}
