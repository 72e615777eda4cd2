"""Checked values of a robot's TOML files: an error names what was expected and what was found."""

import math
from collections.abc import Mapping
from typing import Any, TypeAlias

import numpy as np

from pipeline.arrays import Floats
from pipeline.robot import toml_text
from pipeline.urdf.description import check_name
from recorders.errors import RobotError
from recorders.text.wording import names_text, value_text

Vector: TypeAlias = tuple[float, float, float]

_NONE: frozenset[str] = frozenset()
_NAME_LENGTH = 80  # characters of a name that stands in an error
_COUNTS = {3: "three", 6: "six", 7: "seven"}


def parse_toml(text: str) -> dict[str, Any]:
    """Parse one of a robot's TOML files.

    Raises
    ------
    RobotError
        The text is not TOML, too large, or nested too deeply.
    """
    return toml_text.parse_toml(text, "robot config", error=RobotError)


def check_keys(
    table: Mapping[str, Any], expected: frozenset[str], where: str, *, or_not: frozenset[str] = _NONE
) -> None:
    """Check that a table has the `expected` keys and, beyond them, none but those of `or_not`.

    Raises
    ------
    RobotError
        A key is missing or unknown.
    """
    known = names_text(sorted(expected | or_not))
    unknown = sorted(table.keys() - expected - or_not)
    if missing := sorted(expected - table.keys()):
        instead = f", and has unknown {names_text(unknown)}" if unknown else ""
        raise RobotError(f"{where} lacks {names_text(missing)}{instead}: expected the keys {known}")
    if unknown:
        raise RobotError(f"{where} has unknown {names_text(unknown)}: expected the keys {known}")


def as_table(
    value: object, expected: frozenset[str], where: str, *, or_not: frozenset[str] = _NONE
) -> Mapping[str, Any]:
    """Return `value` if it is a table of these keys; raises RobotError otherwise."""
    if not isinstance(value, dict):
        raise RobotError(f"{where} of the robot config: expected a table, found {value_text(value)}")
    check_keys(value, expected, where, or_not=or_not)
    return value


def row_text(row: object, kind: str, index: int) -> str:
    """Return what a row of a list of tables is called: its kind and its name, or else its place, from 1 on."""
    name = row.get("name") if isinstance(row, dict) else None
    if isinstance(name, str) and name.isprintable() and 0 < len(name) <= _NAME_LENGTH:
        return f"{kind} {name}" if name != kind else kind
    return f"{kind} number {index + 1}"


def as_list(value: object, where: str) -> list[Any]:
    """Return `value` if it is a list; raises RobotError otherwise."""
    if not isinstance(value, list):
        raise RobotError(f"{where} of the robot config: expected a list, found {value_text(value)}")
    return value


def as_name(value: object, where: str) -> str:
    """Return `value` if it can stand as a name; raises RobotError otherwise."""
    return check_name(value, f"{where} of the robot config")


def as_number(value: object, where: str) -> float:
    """Return `value` if it is a finite number; raises RobotError otherwise."""
    try:
        number = float(value) if isinstance(value, int | float) and not isinstance(value, bool) else math.nan
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise RobotError(f"{where} of the robot config: expected a finite number, found {value_text(value)}")
    return number


def as_numbers(value: object, where: str, count: int) -> tuple[float, ...]:
    """Return `value`, so many finite numbers, as a tuple; raises RobotError otherwise."""
    if not isinstance(value, list) or len(value) != count:
        raise RobotError(f"{where} of the robot config: expected {_COUNTS[count]} numbers, found {value_text(value)}")
    return tuple(as_number(entry, where) for entry in value)


def as_vector(value: object, where: str) -> Floats:
    """Return `value`, three finite numbers, as an array (3,); raises RobotError otherwise."""
    return np.array(as_numbers(value, where, 3))


def as_point(value: object, where: str) -> Vector:
    """Return `value`, three finite numbers, as a tuple; raises RobotError otherwise."""
    x, y, z = as_numbers(value, where, 3)
    return x, y, z
