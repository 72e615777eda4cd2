"""Loopback endpoints."""

import socket

_HOST = "127.0.0.1"


def free_endpoint() -> str:
    """Return an endpoint on 127.0.0.1 that nothing listens on at this moment.

    Nobody who asks for any free port is given the same within a minute: a connection there has just been closed, and
    is remembered for that long (TIME_WAIT). Whoever asks for a port by its number, to listen there, may have it.
    """
    with socket.create_server((_HOST, 0)) as server, socket.create_connection(server.getsockname()) as client:
        server.accept()[0].close()  # before the other end: it is the end that closes first that remembers
        client.recv(1)
        return f"tcp/{_HOST}:{server.getsockname()[1]}"
