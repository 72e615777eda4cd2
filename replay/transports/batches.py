"""Cuts a stream into what travels in one payload."""

from collections.abc import Iterator, Sequence

from recorders.messages.record import RecordedMessage

_BATCH_BYTES = 1 << 20  # a batch is closed when it is this large [bytes]


def batches(messages: Iterator[RecordedMessage], size: int) -> Iterator[Sequence[RecordedMessage]]:
    """Cut a stream into chunks of so many messages, and no more than so many bytes."""
    chunk: list[RecordedMessage] = []
    chunk_bytes = 0
    for message in messages:
        message_bytes = len(message.data)
        chunk_bytes += message_bytes
        if chunk_bytes > _BATCH_BYTES and chunk:
            yield chunk
            chunk, chunk_bytes = [], message_bytes
        chunk.append(message)
        if len(chunk) == size:  # at once: a live stream goes on only when this message has gone out
            yield chunk
            chunk, chunk_bytes = [], 0
    if chunk:
        yield chunk
