"""Tables of the report in HTML."""

from collections.abc import Iterable, Sequence
from html import escape


def table(columns: Sequence[str], body: Iterable[Sequence[str]]) -> str:
    """Return a table of cells that are HTML already; a cell that begins with a digit does not break."""
    head = "".join(f"<th>{escape(column)}</th>" for column in columns)
    lines = ["".join(f"{_opening(cell)}{cell}</td>" for cell in row) for row in body]
    return f"<table>\n<tr>{head}</tr>\n" + "\n".join(f"<tr>{line}</tr>" for line in lines) + "\n</table>"


def _opening(cell: str) -> str:
    return '<td class="number">' if cell.lstrip("-")[:1].isdigit() else "<td>"
