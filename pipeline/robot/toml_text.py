"""TOML of others: size and nesting are bounded before the parser sees it.

Python's parser keeps for every part of a dotted key all parts before it: 32 kB of `a.a.a...` take a gigabyte.
"""

import re
import tomllib
from typing import Any

from recorders.errors import ReenactError
from recorders.text.wording import line_text

MAX_BYTES = 32 * 2**10  # 15 joints take two thousand; the time that TOML takes can grow with the square
MAX_DEPTH = 16  # brackets within brackets, and names in a dotted key

# What a quote opens and nothing closes ends where the parser gives up, or later.
_TOKEN = re.compile(
    r"""
    (?P<text>\"{3}(?:[^"\\]|\\.|"(?!""))*+(?:\"{3}\"{0,2})?  # the closing three may follow two of the text's own
        | '{3}(?:[^']|'(?!''))*+(?:'{3}'{0,2})?
        | "(?:[^"\\\n]|\\.)*+"? | '[^'\n]*+'?)
    | (?P<comment>\#[^\n]*+)
    | (?P<bare>[A-Za-z0-9_+-]++)
    | (?P<space>[ \t]++)
    | (?P<dot>\.)
    | (?P<opens>[\[{])
    | (?P<closes>[\]}])
    | .
    """,
    re.VERBOSE | re.DOTALL,
)
_WITHIN_A_KEY = frozenset({"text", "bare", "space", "dot"})


def parse_toml(text: str, what: str, *, error: type[ReenactError]) -> dict[str, Any]:
    """Parse a TOML document that may come from anyone.

    Parameters
    ----------
    text : str
        The document.
    what : str
        What it is, for the message.
    error : type of ReenactError
        What is raised.

    Raises
    ------
    ReenactError
        Of the type `error`: the text is no UTF-8, not TOML, larger than `MAX_BYTES`, or nested deeper than `MAX_DEPTH`.
    """
    try:
        size = len(text.encode())
    except UnicodeEncodeError as wrong:
        raise error(f"{what}: expected UTF-8 text, found {text[wrong.start]!r}") from None
    if size > MAX_BYTES:
        raise error(f"{what}: expected at most {MAX_BYTES} bytes, found {size}")
    if (depth := _depth(text)) > MAX_DEPTH:
        raise error(f"{what}: expected tables, lists and names nested at most {MAX_DEPTH} deep, found {depth}")
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as wrong:
        raise error(f"{what}: expected TOML: {line_text(str(wrong), limit=1000)}") from wrong
    except ValueError as wrong:  # of Python's own, which reads no integer of thousands of digits
        raise error(f"{what}: expected TOML, found an integer of too many digits") from wrong


def _depth(text: str) -> int:
    """Return how deep a document is nested: the most brackets open at once, or names in one dotted key."""
    deepest = brackets = 0
    names = 1
    for token in _TOKEN.finditer(text):
        kind = token.lastgroup
        brackets += (kind == "opens") - (kind == "closes")
        names = names + (kind == "dot") if kind in _WITHIN_A_KEY else 1
        deepest = max(deepest, brackets, names)
    return deepest
