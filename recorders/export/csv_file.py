"""CSV: numbers to the last bit, texts quoted where they must be."""

import csv
from io import TextIOWrapper
from pathlib import Path

from recorders.export.rows import Columns, Row
from recorders.files import disk

SUFFIX = ".csv"


class Table:
    """Writes one table.

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
        self._file = TextIOWrapper(disk.create(path), encoding="utf-8", newline="")
        self._table = csv.writer(self._file, lineterminator="\n")
        self._table.writerow(columns.types)

    def add(self, row: Row) -> None:
        """Write a row."""
        self._table.writerow(
            [
                "" if value is None else repr(value) if isinstance(value, float) else value
                for value in self._columns.values(row)
            ]
        )

    def close(self) -> None:
        """Write what is left, to the disk."""
        with self._file:
            self._file.flush()
            disk.sync(self._file.buffer)
