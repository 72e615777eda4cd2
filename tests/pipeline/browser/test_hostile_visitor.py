"""Whatever is sent to the port: no traceback on the terminal, one line at most, and the page goes on."""

import asyncio
import re
import socket
from contextlib import suppress

import pytest
from visitor_socket import packed, sent_by_visitor
from waiting import wait_until

from pipeline.browser.page.drawing import Sheet
from pipeline.browser.page.gate import Gate
from pipeline.browser.page.scene import Scene
from pipeline.browser.page.server import page_server
from pipeline.robot.config import load_robot

UPGRADE = b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n\r\n"


def answer(port: int, sent: bytes, *, is_all: bool = False) -> bytes:
    """Return all that comes back for some bytes, and it may be that no more follow, until the connection is closed."""
    with socket.create_connection(("127.0.0.1", port)) as connection:
        connection.sendall(sent)
        if is_all:
            connection.shutdown(socket.SHUT_WR)
        return b"".join(iter(lambda: connection.recv(1 << 16), b""))


@pytest.mark.parametrize(
    "sent",
    [
        b"HEAD / HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n",
        b"POST / HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 1\r\n\r\nx",
        b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03" + bytes(64),
        b"GET \x1b[31m\r\n\r\n",
        b"GET / HTTP/1.1\r\nHost" + b"x" * 100_000,
        UPGRADE,
        b"",
    ],
)
def test_what_is_no_request_of_a_browser_causes_a_line_at_most(sent, capfd, caplog):
    with page_server(Gate(), port=None, label="") as server:
        for _ in range(3):
            with suppress(ConnectionResetError):
                answer(server.get_port(), sent, is_all=True)
        assert answer(server.get_port(), b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n").startswith(b"HTTP/1.1 200")
    assert_quiet(capfd, caplog)


def assert_quiet(capfd, caplog):
    """Check that nothing was printed, and at most one line logged, of printable characters."""
    assert capfd.readouterr() == ("", "")
    assert len(caplog.records) <= 1
    for record in caplog.records:
        assert record.name.startswith("pipeline.")
        assert re.fullmatch(r"[^\x00-\x1f\x7f]+", record.getMessage())
        assert record.exc_info is None


def of_scene(kind: str, **fields: object) -> bytes:
    return packed(kind, owner="", **fields)


class Moves:
    """Hands that visitors have moved."""

    def __init__(self) -> None:
        self.places: list[int] = []

    def take(self, place: int, row: object, visitor: int) -> bool:
        self.places.append(place)
        return True


POSE = {"name": "/handles/right", "wxyz": (1.0, 0.0, 0.0, 0.0), "position": (0.0, 0.0, 0.0)}


@pytest.mark.parametrize(
    "message",
    [
        "text",
        b"\x80",
        b"",
        b"\xff" * 100,
        packed("NoSuchMessage"),
        packed("GuiUpdateMessage"),
        of_scene("TransformControlsUpdateMessage", **POSE | {"position": (1.0, 2.0)}),
        of_scene("TransformControlsUpdateMessage", **POSE | {"position": "abc"}),
        of_scene("TransformControlsUpdateMessage", **POSE | {"wxyz": (float("nan"),) * 4}),
        of_scene("TransformControlsUpdateMessage", **POSE | {"position": (1e999, 0.0, 0.0)}),
    ],
)
def test_what_no_page_of_ours_sends_causes_a_line_at_most(message, capfd, caplog):
    robot, moved = load_robot("asimo"), Moves()
    with page_server(Gate(), port=None, label="") as server:
        Scene(server, robot, on_move=moved.take)
        Sheet(server, robot, 0, on_stroke=lambda *stroke: None)
        for _ in range(3):
            asyncio.run(sent_by_visitor(server.get_port(), message))
    assert_quiet(capfd, caplog)
    assert not moved.places


def test_a_handle_that_a_visitor_sends_is_moved(capfd, caplog):
    moved = Moves()
    with page_server(Gate(), port=None, label="") as server:
        Scene(server, load_robot("asimo"), on_move=moved.take)
        asyncio.run(sent_by_visitor(server.get_port(), of_scene("TransformControlsUpdateMessage", **POSE)))
        wait_until(lambda: moved.places)
    assert moved.places == [1]
    assert_quiet(capfd, caplog)


def test_a_page_of_another_viser_prints_nothing(capfd, caplog):
    with page_server(Gate(), port=None, label="") as server:
        for _ in range(3):
            asyncio.run(sent_by_visitor(server.get_port(), b"", version="viser-v0.0.1"))
    assert_quiet(capfd, caplog)
