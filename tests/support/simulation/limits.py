"""Limits of the protocol, lowered to what simulated messages of some bytes reach."""

from collections.abc import Iterator
from contextlib import contextmanager

from recorders.protocol import known_streams, send_window, stream

PAST_STREAMS = 2

_LOWERED = (send_window, "WINDOW_BYTES"), (stream, "WINDOW_BYTES"), (known_streams, "_MAX_PAST")


@contextmanager
def lowered_limits(*, window_bytes: int) -> Iterator[None]:
    """Let less be under way, and be remembered, while the block runs."""
    before = [getattr(module, name) for module, name in _LOWERED]
    lowered = window_bytes, window_bytes, PAST_STREAMS
    try:
        for (module, name), limit in zip(_LOWERED, lowered, strict=True):
            setattr(module, name, limit)
        yield
    finally:
        for (module, name), limit in zip(_LOWERED, before, strict=True):
            setattr(module, name, limit)
