"""What a log in the making keeps in memory does not grow with its length, and its index is whole all the same."""

import gc
import tracemalloc
from pathlib import Path

import pytest
from mcap.reader import make_reader

from recorders.writing.chunk_writer import FLUSH_EVERY
from recorders.writing.writer import LogWriter

WARM_UP, MORE = 200, 3200  # chunks
SMALL = 4  # messages of a chunk: a log grows in memory by its chunks, if it does


def write(log: LogWriter, chunks: int, of_messages: int) -> None:
    for number in range(chunks * of_messages):
        topic = f"/topic_{number % 4}"
        log.write(topic, b"data", log_time_ns=1_700_000_000_000_000_000 + number, sequence=number, opaque=True)
        if (number + 1) % of_messages == 0:
            log.flush()


def allocated() -> int:
    gc.collect()
    return tracemalloc.get_traced_memory()[0]


@pytest.mark.parametrize("rechunk", [False, True])
def test_the_memory_of_a_recording_does_not_grow(tmp_path: Path, rechunk: bool) -> None:
    with LogWriter(tmp_path / "log.mcap", manifest={}, rechunk=rechunk) as log:
        write(log, WARM_UP, SMALL)
        tracemalloc.start()
        try:
            before = allocated()
            write(log, MORE, SMALL)
            grown = allocated() - before
        finally:
            tracemalloc.stop()
    assert grown < 20 * MORE  # bytes; an entry of the index takes a thousand


@pytest.mark.parametrize("piece", [7, 2**20])
def test_every_chunk_is_in_the_index_in_order(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, piece: int) -> None:
    monkeypatch.setattr("recorders.writing.chunk_index_file._PIECE", piece)
    with LogWriter(tmp_path / "log.mcap", manifest={}) as log:
        write(log, 5, FLUSH_EVERY)
    with log.path.open("rb") as file:
        summary = make_reader(file).get_summary()
        assert summary is not None
        starts = [index.chunk_start_offset for index in summary.chunk_indexes]
        found = list(make_reader(file).iter_messages())
    assert len(starts) == 5
    assert starts == sorted(starts)
    assert len(found) == 5 * FLUSH_EVERY
    assert all(set(index.message_index_offsets) == {1, 2, 3, 4} for index in summary.chunk_indexes)
