"""What was found of a new robot as tables: its joints, its hands."""

from collections.abc import Mapping, Sequence
from typing import Any

from rich.table import Table
from rich.text import Text

from recorders.text.wording import escape_control

_NUMBERS = frozenset({"lower", "upper", "comfort", "reach", "freedom"})


def robot_table(rows: Sequence[Mapping[str, Any]], columns: Sequence[str]) -> Table:
    """Return a table of the rows' entries of these columns, for 80 columns; texts come from a URDF and are escaped."""
    table = Table(box=None, pad_edge=False)
    for name in columns:
        table.add_column(name, overflow="fold", justify="right" if name in _NUMBERS else "left")
    for row in rows:
        table.add_row(*(Text(escape_control(_cell(row[name]))) for name in columns))
    return table


def _cell(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.2f}"
    return " ".join(map(_cell, value)) if isinstance(value, list | tuple) else str(value)
