"""Ports of this machine alone."""

import socket

HOST = "127.0.0.1"


def free_port() -> int:
    """Return a port of 127.0.0.1 that nothing listens on at this moment.

    Nobody who asks for any free port is given the same within a minute: a connection there has just been closed, and
    is remembered for that long (TIME_WAIT). Whoever asks for a port by its number, to listen there, may have it.
    """
    with socket.create_server((HOST, 0)) as server, socket.create_connection(server.getsockname()) as client:
        server.accept()[0].close()  # before the other end: it is the end that closes first that remembers
        client.recv(1)
        return int(server.getsockname()[1])
