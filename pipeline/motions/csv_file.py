"""Numbers over time from a CSV file: columns found by name, and a bad cell refused by line and column."""

import csv
import math
from array import array
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from decimal import Decimal
from itertools import count, pairwise
from pathlib import Path
from typing import TextIO, TypeAlias

import numpy as np

from pipeline.arrays import Floats
from recorders.errors import MotionError, file_reason
from recorders.files.regular_file import require_regular_file
from recorders.reading.file_kind import mixed_up_kind

MAX_COORDINATE_M = 100.0  # of any robot's hand: what lies beyond is in another unit, or no number at all
MAX_TIME_S = 1e6  # eleven days: a float64 still separates their nanoseconds
MAX_ROWS = 1_000_000  # nearly three hours at 100 Hz
MAX_GAP_S = 5.0  # a hand does not rest for longer unseen; milliseconds taken for seconds exceed it below 200 Hz

_MM = 1e4  # a coordinate between 100 m and this is taken to be one in millimetres
_POINTS = "numbers are written with a decimal point, not a decimal comma"
_MAX_LINE = 100_000  # characters: of any table
_MAX_CLOCK_S = 1e10  # Unix time gets there in the year 2286

Choice: TypeAlias = Callable[[Sequence[str]], Sequence[str]]
"""Returns the columns wanted, `t` first, of those that a header has; raises MotionError if it lacks one."""


def read_table(path: Path, *, choose: Choice, max_coordinate: float = MAX_COORDINATE_M) -> Floats:
    """Read columns of numbers, the first of them strictly increasing times [s].

    Other columns are left alone; empty lines and lines that start with # are skipped. Times beyond `MAX_TIME_S`, such
    as Unix times, are counted from the first.

    Parameters
    ----------
    path : Path
        A CSV file with a header, in UTF-8 with or without a byte order mark.
    choose : callable
        Names the columns wanted.
    max_coordinate : float
        Largest number accepted in any column but the first.

    Returns
    -------
    ndarray, shape (T, columns), T >= 2

    Raises
    ------
    MotionError
        The file cannot be read, lacks a column or has two of one name, has a row longer or shorter than its header,
        holds something else than finite numbers of a plausible size, has fewer than two rows or more than `MAX_ROWS`
        (twice as many lines),
        or its times do not increase or leave a gap above `MAX_GAP_S`; the message names line and column.
    """
    lines, since_first_s, numbers = array("q"), array("d"), array("d")  # a list would take ten times as much
    first: Decimal | None = None
    for line, time, values in _read_rows(path, choose, max_coordinate):
        if len(lines) == MAX_ROWS:
            raise MotionError(f"motion '{path}', line {line}: expected at most {MAX_ROWS} rows of numbers")
        first = time if first is None else first
        lines.append(line)
        since_first_s.append(float(time - first))  # subtracted exactly, before a float holds it
        numbers.extend(values)
    if len(lines) < 2:
        raise MotionError(f"motion '{path}': expected at least two rows of numbers, found {len(lines)}")
    table = np.array(numbers).reshape(len(lines), -1)
    if np.abs(table[:, 0]).max() > MAX_TIME_S:
        table[:, 0] = since_first_s
    for line, (before, after) in zip(lines[1:], pairwise(table[:, 0].tolist()), strict=True):
        _check_step(f"motion '{path}', line {line}, column t", before, after)
    return table


def _check_step(where: str, before: float, after: float) -> None:
    if after <= before:
        raise MotionError(f"{where}: expected a time above {before:g}, found {after:g}")
    if after - before > MAX_GAP_S:
        raise MotionError(
            f"{where}: expected at most {MAX_GAP_S:g} s since the row before, found {after - before:g}; "
            "are the times in seconds?"
        )


def _read_rows(path: Path, choose: Choice, max_coordinate: float) -> Iterator[tuple[int, Decimal, list[float]]]:
    """Line number, time as it is written [s], and the values of the columns wanted of each row."""
    require_regular_file(path, expected="a CSV file", error=MotionError)
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            reader = csv.reader(_lines(path, file), strict=True)
            header: list[str] | None = None
            indices: dict[str, int] = {}
            for row in reader:
                where = f"motion '{path}', line {reader.line_num}"
                if not any(cell.strip() for cell in row) or row[0].lstrip().startswith("#"):
                    continue
                if header is None:
                    header = [cell.strip() for cell in row]
                    indices = _indices(path, header, choose)
                else:
                    _check_length(where, row, len(header))
                    values = _values(where, row, indices, max_coordinate)
                    yield reader.line_num, Decimal(row[indices["t"]]), values
            if reader.line_num == 0:
                raise MotionError(f"motion '{path}': expected CSV text, found an empty file")
    except OSError as error:
        raise MotionError(f"cannot read motion '{path}': {file_reason(error)}") from error
    except UnicodeDecodeError as error:
        found = mixed_up_kind(error.object) or f"byte {error.object[error.start]:#04x}"
        raise MotionError(f"motion '{path}': expected CSV text in UTF-8, found {found}") from error
    except csv.Error as error:
        raise MotionError(f"motion '{path}', line {reader.line_num}: expected CSV text: {error}") from error


def _lines(path: Path, file: TextIO) -> Iterator[str]:
    for number in count(1):
        if not (line := file.readline(_MAX_LINE + 1)):
            return
        if number > 2 * MAX_ROWS:
            raise MotionError(f"motion '{path}', line {number}: expected at most {2 * MAX_ROWS} lines")
        if len(line) > _MAX_LINE:
            raise MotionError(f"motion '{path}', line {number}: expected at most {_MAX_LINE} characters")
        yield line


def _indices(path: Path, header: list[str], choose: Choice) -> dict[str, int]:
    for mark, name in ((";", "semicolons"), ("\t", "tabs")):
        if len(header) == 1 and mark in header[0]:
            expected = "expected commas between the columns and points in the numbers"
            raise MotionError(f"motion '{path}': {expected}, found {name}: {_brief(header[0])}")
    if repeated := [column for column, count in Counter(filter(None, header)).items() if count > 1]:
        raise MotionError(f"motion '{path}': expected each column once, found '{_brief(repeated[0])}' more than once")
    try:
        return {column: header.index(column) for column in choose(header)}
    except MotionError as error:
        raise MotionError(f"motion '{path}': {error}, found {_brief(','.join(header))}") from None


def _check_length(where: str, row: list[str], expected: int) -> None:
    if len(row) != expected:
        ask = f"; {_POINTS}" if len(row) > expected else ""
        raise MotionError(f"{where}: expected {expected} cells, found {len(row)}{ask}")


def _brief(text: str) -> str:
    return f"{' '.join(text.split()):.80}"


def _values(where: str, row: list[str], indices: dict[str, int], max_coordinate: float) -> list[float]:
    values = []
    for column, index in indices.items():
        limit, unit = (_MAX_CLOCK_S, "s") if column == "t" else (max_coordinate, "m")
        values.append(_value(f"{where}, column {column}", row[index], limit, unit))
    return values


def _value(where: str, text: str, limit: float, unit: str) -> float:
    try:
        value = math.nan if "_" in text else float(text)  # Python's 1_000 is nobody's number
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        ask = f"; {_POINTS}" if "," in text else ""
        raise MotionError(f"{where}: expected a finite number, found '{_brief(text)}'{ask}")
    if abs(value) > limit:
        ask = "; are the times in seconds?" if unit == "s" else ": looks like millimetres" if abs(value) <= _MM else ""
        raise MotionError(f"{where}: expected at most {limit:g} {unit} from zero, found {value:g}{ask}")
    return value
