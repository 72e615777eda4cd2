"""Loopback endpoints."""

import socket


def free_endpoint() -> str:
    """Return an endpoint on 127.0.0.1 that nothing listens on at this moment."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"
