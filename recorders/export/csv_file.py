"""CSV: numbers to the last bit, texts quoted where they must be."""

import csv
from collections.abc import Iterable
from pathlib import Path

from recorders.export.rows import Columns, Row

SUFFIX = ".csv"


def write(path: Path, columns: Columns, rows: Iterable[Row]) -> int:
    """Write a table and return how many rows it has; raises OSError if that fails."""
    count = 0
    with path.open("w", encoding="utf-8", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(columns.types)
        for row in rows:
            table.writerow(
                [
                    "" if value is None else repr(value) if isinstance(value, float) else value
                    for value in columns.values(row)
                ]
            )
            count += 1
    return count
