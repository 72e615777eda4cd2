"""Transports and clocks of ours, and of somebody else's, against the contracts that ship with the package."""

import queue
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from recorders.errors import WireError
from recorders.messages.record import RecordedMessage
from recorders.protocol.stream import Consumer, Offer
from recorders.wire.loopback import free_endpoint
from recorders.wire.queries import ReceivedOffer
from recorders.wire.receiver import Receiver, ReceiverConfig
from recorders.wire.session import SessionConfig, open_session
from replay.transports.clock import Clock, Paced, Pausable, Unpaced
from replay.transports.contract import ClockContract, TransportContract
from replay.transports.sender_config import SenderConfig
from replay.transports.transport import InProcess, StreamFrom
from replay.transports.zenoh import ZenohTransport


class TestInProcess(TransportContract):
    def deliver(self, consumer: Consumer, offer: Offer, stream_from: StreamFrom) -> dict[str, Any]:
        return InProcess({"learner": consumer}).deliver(offer, stream_from)["learner"]


class Once(Receiver):
    """Waits for no other offer when it has refused one."""

    def refuse(self, offered: ReceivedOffer, reason: str) -> None:
        super().refuse(offered, reason)
        raise WireError(reason)


class TestZenoh(TransportContract):
    def deliver(self, consumer: Consumer, offer: Offer, stream_from: StreamFrom) -> dict[str, Any]:
        endpoint = free_endpoint()
        with (
            open_session(SessionConfig(listen=(endpoint,))) as here,
            open_session(SessionConfig(connect=(endpoint,))) as there,
            Once(there, config=ReceiverConfig(name="learner")) as receiver,
            ThreadPoolExecutor(1) as thread,
        ):
            served = thread.submit(receiver.serve, consumer, wait_s=120.0)
            try:
                transport = ZenohTransport(here, config=SenderConfig(wait_s=120.0))
                return transport.deliver(offer, stream_from)["learner"]
            finally:
                served.exception()


class Handed:
    """A transport as somebody else writes it: one thread hands each message to another."""

    def __init__(self, consumer: Consumer) -> None:
        self._consumer = consumer

    def deliver(self, offer: Offer, stream_from: StreamFrom) -> dict[str, dict[str, Any]]:
        start = self._consumer.hello(offer)
        waiting: queue.Queue[RecordedMessage | BaseException | None] = queue.Queue(maxsize=8)
        over = threading.Event()

        def send() -> None:
            last: BaseException | None = None
            try:
                for record in stream_from(start):
                    if over.is_set():
                        return
                    waiting.put(record)
            except Exception as error:
                last = error
            waiting.put(last)

        def received() -> Iterator[RecordedMessage]:
            while (item := waiting.get()) is not None:
                if isinstance(item, BaseException):
                    raise item
                yield item

        with ThreadPoolExecutor(1) as sender:
            sender.submit(send)
            try:
                return {"learner": self._consumer.consume(received())}
            finally:
                over.set()
                while not waiting.empty():
                    waiting.get_nowait()


class TestHanded(TransportContract):
    def deliver(self, consumer: Consumer, offer: Offer, stream_from: StreamFrom) -> dict[str, Any]:
        return Handed(consumer).deliver(offer, stream_from)["learner"]


class TestUnpaced(ClockContract):
    def clock(self) -> Clock:
        return Unpaced()


class TestPaced(ClockContract):
    def clock(self) -> Clock:
        return Paced(1000.0)


class TestPausable(ClockContract):
    def clock(self) -> Clock:
        return Pausable(Paced(1000.0))


class Counting:
    """A clock as somebody else writes it: it counts, and waits for nothing."""

    def __init__(self) -> None:
        self.waits = self.paused_ns = 0

    def wait(self, log_time_ns: int) -> None:
        self.waits += 1

    def delay(self, pause_ns: int) -> None:
        self.paused_ns += pause_ns


class TestCounting(ClockContract):
    def clock(self) -> Clock:
        return Counting()
