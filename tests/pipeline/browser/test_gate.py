"""Who may see and lead: connections from the page itself, to this machine's own name, with a token if there is one."""

import asyncio
import socket
from contextlib import suppress

import pytest
import websockets
from websockets.datastructures import Headers
from websockets.typing import Subprotocol

from pipeline.browser.page.gate import Gate
from pipeline.browser.page.server import page_server
from recorders.errors import ConfigError

TOKEN = "0123456789abcdef"


async def greeting(port, *, host=None, query="", **headers):
    """Return the first thing that the server sends to a connection, or why it is turned away."""
    import viser

    if host is not None:
        headers["Host"] = host
    async with websockets.connect(
        f"ws://127.0.0.1:{port}/{query}",
        subprotocols=[Subprotocol(f"viser-v{viser.__version__}")],
        additional_headers=headers,
    ) as connection:
        try:
            return await connection.recv()
        except websockets.ConnectionClosed as closed:
            return closed.rcvd.reason


def asked(port, **options):
    return asyncio.run(greeting(port, **options))


def test_on_loopback_only_the_page_itself_gets_in():
    with page_server(Gate(), port=None, label="") as server:
        port = server.get_port()
        assert isinstance(asked(port), bytes)
        assert isinstance(asked(port, Origin=f"http://127.0.0.1:{port}"), bytes)
        assert asked(port, Origin="http://elsewhere.example") == "it comes from another page"
        assert asked(port, Origin="null") == "it comes from another page"
        assert not server._websock_server._client_state_from_id


@pytest.mark.parametrize(
    ("path", "headers", "reason"),
    [
        ("/", {"Host": "127.0.0.1:8080"}, ""),
        ("/", {"Host": "[::1]:8080", "Origin": "http://[::1]:8080"}, ""),
        ("/", {"Host": "evil.example:8080", "Origin": "http://evil.example:8080"}, "it names another host"),
        ("/", {}, "it names another host"),
    ],
)
def test_a_name_that_is_made_to_mean_this_machine_opens_nothing(path, headers, reason):
    assert Gate().refusal(path, headers) == reason


@pytest.mark.parametrize("gate", [Gate(), Gate("0.0.0.0", TOKEN)])
@pytest.mark.parametrize(
    ("path", "headers"),
    [
        ("/", [("Host", "127.0.0.1:1"), ("Origin", "http://[")]),
        ("/", [("Host", "127.0.0.1:1"), ("Host", "127.0.0.1:1")]),
        ("/", [("Host", "127.0.0.1:1"), ("Origin", "http://127.0.0.1:1"), ("Origin", "http://127.0.0.1:1")]),
    ],
)
def test_a_request_that_no_browser_makes_is_refused(gate, path, headers):
    assert gate.refusal(path, Headers(headers)) == "it is no request of a browser"


@pytest.mark.parametrize("path", ["http://[", "/?token=\udcff"])
def test_a_path_that_is_none_is_refused(path):
    assert Gate("0.0.0.0", TOKEN).refusal(path, {"Host": "here:1"}) == "it is no request of a browser"


@pytest.mark.parametrize("host", ["0.0.0.0", "::"])
def test_a_page_on_all_addresses_is_found_by_the_name_of_the_machine(host):
    here = f"{socket.gethostname()}:8080"
    assert Gate(host, TOKEN).address(8080) == f"http://{here}/?websocket=ws://{here}/?token={TOKEN}"


def test_with_a_token_nobody_gets_in_without_it():
    gate = Gate("0.0.0.0", TOKEN)
    with page_server(gate, port=None, label="") as server:
        port = server.get_port()
        assert gate.address(port).endswith(f"?token={TOKEN}")
        assert asked(port) == asked(port, query="?token=0123456789abcdeF") == "the token is not the right one"
        assert isinstance(asked(port, query=f"?token={TOKEN}"), bytes)
        assert asked(port, query=f"?token={TOKEN}", Origin="http://elsewhere.example") == "it comes from another page"


def test_what_is_asked_before_the_refusal_is_not_done():
    import viser

    async def intrude(port):
        async with websockets.connect(
            f"ws://127.0.0.1:{port}/", subprotocols=[Subprotocol(f"viser-v{viser.__version__}")]
        ) as connection:
            with suppress(websockets.ConnectionClosed):
                await connection.send(b"\x80")  # which no handler would survive
                await connection.recv()

    with page_server(Gate("0.0.0.0", TOKEN), port=None, label="") as server:
        asyncio.run(intrude(server.get_port()))
        assert not server.get_clients()
        assert isinstance(asked(server.get_port(), query=f"?token={TOKEN}"), bytes)


@pytest.mark.parametrize("token", ["", "short", "0123456789abcde!", "0123456789abcdé0"])
def test_a_page_for_others_needs_a_token_that_is_one(token):
    with pytest.raises(ConfigError, match=r"--token|--host"):
        Gate("0.0.0.0", token)


def test_a_port_that_is_taken_is_named():
    with (
        page_server(Gate(), port=None, label="") as server,
        pytest.raises(ConfigError, match=f"--port {server.get_port()}: .*in use"),
        page_server(Gate(), port=server.get_port(), label=""),
    ):
        pass


def test_no_visitor_can_have_the_page_shared_through_a_service():
    from viser import _messages

    with page_server(Gate(), port=None, label="") as server:
        assert _messages.ShareUrlRequest not in server._websock_server._incoming_handlers
