"""Rows are found again by their stamps, many at a time, in memory while they are few and else in a file."""

import struct
from collections.abc import Sequence
from itertools import product

import pytest

from pipeline.alignment import row_store
from pipeline.alignment.row_store import RowStore

SIZE = 24
STAMPS = (10, 10, 20, 30, 30, 30, 40)


def row(number: int, stamp_ns: int) -> bytes:
    return struct.pack("<qqq", stamp_ns, number, -number)


ROWS = [row(number, stamp) for number, stamp in enumerate(STAMPS)]


def stored(blocks: Sequence[Sequence[bytes]]) -> RowStore:
    store = RowStore(SIZE)
    for block in blocks:
        store.append(b"".join(block))
    return store


def test_rows_of_a_span_are_those_of_its_stamps() -> None:
    store = stored([ROWS[:3], [], ROWS[3:4], ROWS[4:]])
    assert len(store) == len(ROWS)
    assert [store.stamp(place) for place in range(len(ROWS))] == [*STAMPS]
    for start, end in product(range(0, 55, 5), repeat=2):
        found = b"".join(store.rows(start, end))
        assert found == b"".join(row for row, stamp in zip(ROWS, STAMPS, strict=True) if start <= stamp < end)


def test_rows_may_be_added_after_some_were_read() -> None:
    store = stored([ROWS[:4]])
    assert b"".join(store.rows(0, 11)) == b"".join(ROWS[:2])
    store.append(b"".join(ROWS[4:]))
    assert b"".join(store.rows(0, 99)) == b"".join(ROWS)


@pytest.mark.parametrize(("read", "counts"), [(1 << 20, [7]), (3 * SIZE + 5, [3, 3, 1]), (SIZE - 1, [1] * 7)])
def test_rows_come_as_many_at_a_time_as_fit_but_one_at_least(
    monkeypatch: pytest.MonkeyPatch, read: int, counts: list[int]
) -> None:
    monkeypatch.setattr(row_store, "_READ", read)
    assert [len(block) // SIZE for block in stored([ROWS]).rows(0, 99)] == counts


def test_many_rows_lie_in_a_file_that_is_closed_with_the_store(monkeypatch: pytest.MonkeyPatch) -> None:
    assert 1 << 20 <= row_store.IN_MEMORY <= 1 << 28
    assert 1 << 12 <= row_store._READ <= row_store.IN_MEMORY
    monkeypatch.setattr(row_store, "IN_MEMORY", 3 * SIZE)
    few, many = stored([ROWS[:3]]), stored([ROWS])
    assert (few._file._rolled, many._file._rolled) == (False, True)  # type: ignore[attr-defined]
    assert b"".join(many.rows(0, 99)) == b"".join(ROWS)
    file = many._file
    del many
    assert file.closed
