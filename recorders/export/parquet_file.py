"""Parquet, by pyarrow; needs the extra `parquet`."""

from collections.abc import Iterable
from itertools import islice
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from recorders.export.rows import Columns, Row

SUFFIX = ".parquet"

_AT_ONCE = 8192  # rows
_TYPES = {bool: pa.bool_(), int: pa.int64(), float: pa.float64(), str: pa.string()}


def write(path: Path, columns: Columns, rows: Iterable[Row]) -> int:
    """Write a table and return how many rows it has; raises OSError if that fails."""
    schema = pa.schema([(name, _TYPES[kind]) for name, kind in columns.types.items()])
    count, left = 0, iter(rows)
    with pq.ParquetWriter(path, schema, compression="zstd") as table:
        while some := [columns.values(row) for row in islice(left, _AT_ONCE)]:
            arrays = [
                pa.array(column, field.type) for column, field in zip(zip(*some, strict=True), schema, strict=True)
            ]
            table.write_table(pa.Table.from_arrays(arrays, schema=schema))
            count += len(some)
    return count
