"""Escaping of texts that come from anyone: control characters are spelt out, and lines fit the terminal."""

import re
from collections.abc import Iterator

from rich.cells import cell_len, chop_cells

_NARROWEST = 20  # columns of text: a terminal of fewer breaks lines by itself


def wrapped(text: str, width: int, *, indent: str = "", hanging: str | None = None) -> Iterator[str]:
    """Yield a text in lines of at most `width` columns, broken between words.

    A word that is longer is broken behind a slash, or where there is none after as much as fits.

    Parameters
    ----------
    text : str
        Printable, without line ends.
    width : int
        Columns of the terminal.
    indent, hanging : str
        What the first line and the others begin with; the same if only one is given.
    """
    hanging = indent if hanging is None else hanging
    room = max(width - cell_len(hanging), _NARROWEST)
    start, line = indent, ""
    for word in text.split(" "):
        for number, part in enumerate(_parts(word, room)):
            space = " " if line and not number else ""
            if line and cell_len(line) + len(space) + cell_len(part) > room:
                yield start + line
                start, line, space = hanging, "", ""
            line += space + part
    yield start + line


def _parts(word: str, room: int) -> Iterator[str]:
    """Yield a word in the pieces that it may be broken into: one, if there is room for it."""
    if cell_len(word) <= room:
        yield word
        return
    for piece in re.findall(r"[^/]*/|[^/]+", word):
        yield from chop_cells(piece, room)
