"""Parquet, by pyarrow; needs the extra `parquet`."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from recorders.export.rows import Columns, Row
from recorders.files import disk

SUFFIX = ".parquet"

_MOST_ROWS = 8192  # held until they are written
_MOST_CELLS = 2**17
_MOST_TEXT = 2**21  # characters
_TYPES = {bool: pa.bool_(), int: pa.int64(), float: pa.float64(), str: pa.string()}


class Table:
    """Writes one table, many rows at a time.

    Parameters
    ----------
    path : Path
        The file to make.
    columns : Columns
        Of all its rows.

    Raises
    ------
    OSError
        If it cannot be written; from every method, too.
    """

    def __init__(self, path: Path, columns: Columns) -> None:
        self._columns = columns
        self._schema = pa.schema([(name, _type_of(columns, name)) for name in columns.types])
        self._most = min(_MOST_ROWS, _MOST_CELLS // (len(columns.types) or 1))
        self._file = disk.create(path)
        try:
            self._table = pq.ParquetWriter(self._file, self._schema, compression="zstd")
        except BaseException:
            self._file.close()
            raise
        self._held: list[Sequence[Any]] = []
        self._text = 0

    def add(self, row: Row) -> None:
        """Take in a row."""
        values = self._columns.values(row)
        self._held.append(values)
        self._text += sum(len(value) for value in values if isinstance(value, str))
        if len(self._held) >= self._most or self._text >= _MOST_TEXT:
            self._write()

    def close(self) -> None:
        """Write what is left, to the disk."""
        try:
            with self._file:
                if self._held:
                    self._write()
                self._table.close()
                self._file.flush()
                disk.sync(self._file)
        finally:
            self._table.is_open = False  # otherwise it tries again, and prints why it fails, when it is collected

    def _write(self) -> None:
        columns = zip(zip(*self._held, strict=True), self._schema, strict=True)
        arrays = [pa.array(column, field.type) for column, field in columns]
        self._table.write_table(pa.Table.from_arrays(arrays, schema=self._schema))
        self._held, self._text = [], 0


def _type_of(columns: Columns, name: str) -> pa.DataType:
    kind = columns.types[name]
    return pa.uint64() if kind is int and columns.is_unsigned(name) else _TYPES[kind]
