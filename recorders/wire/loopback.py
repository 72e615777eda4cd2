"""Loopback endpoints."""

from recorders.loopback import HOST, free_port


def free_endpoint() -> str:
    """Return an endpoint on 127.0.0.1 that nobody else is given, as `free_port` has it."""
    return f"tcp/{HOST}:{free_port()}"
