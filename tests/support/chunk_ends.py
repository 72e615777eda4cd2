"""Where the chunks of a sound log end, by MCAP's own library: what lies before damage must be read."""

from pathlib import Path

from mcap.records import Chunk, Message
from mcap.stream_reader import StreamReader, breakup_chunk


def chunk_ends(path: Path) -> list[tuple[int, int]]:
    """Return, for each chunk, the byte at which it ends and the messages up to there; at least one has some."""
    ends, messages = [], 0
    with path.open("rb") as file:
        for record in StreamReader(file, emit_chunks=True).records:
            if isinstance(record, Chunk):
                messages += sum(isinstance(inner, Message) for inner in breakup_chunk(record))
                ends.append((file.tell(), messages))
    assert messages > 0
    return ends


def whole_before(ends: list[tuple[int, int]], place: int) -> int:
    """Return how many messages lie in chunks that end before a byte."""
    return max((messages for end, messages in ends if end <= place), default=0)
