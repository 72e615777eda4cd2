"""The server of the page: what any thread shows is sent, and never through what only the server's own may touch."""

import asyncio
import threading
from collections import deque

import pytest
from visitor_socket import visiting
from waiting import wait_until

from pipeline.browser.page.gate import Gate
from pipeline.browser.page.server import page_server


class Waiters(deque):
    """Waiters of an event, and the threads that went through them."""

    def __init__(self, event: asyncio.Event) -> None:
        super().__init__(event._waiters)
        event._waiters = self
        self.threads: set[threading.Thread] = set()

    def __iter__(self):
        self.threads.add(threading.current_thread())
        return super().__iter__()


def on_loop(server, make):
    """Return what is made on the server's own thread."""

    async def made():
        return make()

    return asyncio.run_coroutine_threadsafe(made(), server.get_event_loop()).result()


@pytest.mark.parametrize("of_all", [True, False])
def test_who_waits_to_send_is_woken_by_the_servers_thread_alone(of_all):
    with page_server(Gate(), port=None, label="") as server, visiting(server) as visitor:
        client = server.get_clients()[visitor.number]
        connection, gui = (server._websock_server, server.gui) if of_all else (client._websock_connection, client.gui)
        event = connection.get_message_buffer().message_event
        waiters = on_loop(server, lambda: Waiters(event))
        for number in range(20):
            gui.add_html(f"{number}")
            wait_until(lambda: not event.is_set())  # it was sent
    assert threading.current_thread() not in waiters.threads
