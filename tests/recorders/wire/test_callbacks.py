"""A callback without a thread of its own, on threads that keep what Python needs on them."""

import queue
import threading

from waiting import matches, wait_until

from recorders.wire.callbacks import on_network_thread
from recorders.wire.loopback import free_endpoint
from recorders.wire.session import SessionConfig, open_session

COUNT = 50


def test_a_thread_of_zenohs_keeps_its_state_between_two_calls() -> None:
    of_thread = threading.local()  # goes with the state
    heard: queue.SimpleQueue[tuple[int, int, bytes]] = queue.SimpleQueue()

    def count(sample) -> None:
        of_thread.calls = getattr(of_thread, "calls", 0) + 1
        heard.put((threading.get_ident(), of_thread.calls, sample.payload.to_bytes()))

    endpoint = free_endpoint()
    with (
        open_session(SessionConfig(listen=(endpoint,))) as listening,
        open_session(SessionConfig(connect=(endpoint,))) as sending,
        listening.declare_subscriber("a/b", on_network_thread(count)),
        sending.declare_publisher("a/b") as publisher,
    ):
        wait_until(lambda: matches(publisher))
        for number in range(COUNT):
            publisher.put(bytes([number]))
        calls = [heard.get(timeout=120) for _ in range(COUNT)]
    assert [payload for _, _, payload in calls] == [bytes([number]) for number in range(COUNT)]
    assert threading.main_thread().ident not in {thread for thread, _, _ in calls}
    seen: dict[int, int] = {}
    for thread, number, _ in calls:
        seen[thread] = seen.get(thread, 0) + 1
        assert number == seen[thread]
