"""Words of error lines: values and kinds of value as whoever wrote a file knows them, with nothing of Python's."""

import datetime
import json
from collections.abc import Iterable, Sequence
from difflib import get_close_matches

_KINDS = {
    str: "a text",
    bool: "true or false",
    int: "a whole number",
    float: "a number",
    list: "a list",
    dict: "a table",
    type(None): "nothing",
}


def kind_text(kind: type) -> str:
    """Return what a kind of value is called outside Python, such as "a whole number"."""
    return _KINDS.get(kind, kind.__name__)


def value_text(value: object, *, limit: int = 80) -> str:
    """Return a value for an error line, cut to `limit` characters: `nothing`, `true`, 'text', numbers as they are.

    Dates and times are written as in ISO 8601. Bytes read as text, with whatever is no ASCII spelt out.
    """
    if value is None:
        return "nothing"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, datetime.date | datetime.time):
        return value.isoformat()
    if isinstance(value, dict | list):
        return f"{kind_text(type(value))} of {len(value)}"
    try:
        text = repr(bytes(value))[1:] if isinstance(value, bytes | bytearray | memoryview) else repr(value)
    except ValueError:  # a whole number of thousands of digits
        return f"{kind_text(type(value))}, a huge one"
    return text if len(text) <= limit else f"{text[: limit - 1]}…"


def names_text(names: Iterable[str], *, limit: int = 600) -> str:
    """Return names for an error line, one after another: about `limit` characters of them, and how many more there are.

    An empty text for no names. A log or a robot from anyone may have 65,000 of them, or one of a megabyte.
    """
    every = list(names)
    shown: list[str] = []
    room = limit
    for name in every:
        line = " ".join(name.split())
        cut = line if len(line) <= limit // 2 else f"{line[: limit // 2]}…"
        room -= len(cut) + 2
        if shown and room < 0:
            break
        shown.append(cut)
    more = len(every) - len(shown)
    return ", ".join(shown) + (f" and {more} more" if more else "")


def hand_text(name: str) -> str:
    """Return what a hand is called behind its kind, as in a sentence; one called `hand` is the hand.

    Examples
    --------
    >>> hand_text("left"), hand_text("hand")
    ('hand left', 'hand')
    """
    return "hand" if name == "hand" else f"hand {name}"


def hand_label(name: str) -> str:
    """Return what a hand is called before its kind, as beside a curve; one called `hand` is the hand.

    Examples
    --------
    >>> hand_label("left"), hand_label("hand")
    ('left hand', 'hand')
    """
    return "hand" if name == "hand" else f"{name} hand"


def json_fault_text(error: Exception) -> str:
    """Return what is wrong with a text that could not be read as JSON, from what the reader raised."""
    if isinstance(error, json.JSONDecodeError):
        return str(error)
    if isinstance(error, UnicodeDecodeError):
        return "found bytes that are no UTF-8"
    return "nested too deeply" if isinstance(error, RecursionError) else "found a whole number of too many digits"


def line_text(text: str, *, limit: int = 3000) -> str:
    """Return a text as one line of at most about `limit` characters; what is left out of a longer one is its middle."""
    line = " ".join(text.split())
    if len(line) <= limit:
        return line
    end = limit // 4  # what to do comes last
    return f"{line[: limit - end]} … ({len(line) - limit} characters) … {line[-end:]}"


def escape_control(text: str) -> str:
    """Return a text with everything that a terminal might obey, such as an escape, spelt out."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def did_you_mean(wanted: str, known: Sequence[str]) -> str:
    """Return the question whether another name was meant, if one is near or begins so; empty if none does.

    >>> did_you_mean("circels", ["circles", "eight"])
    '; did you mean circles?'
    """
    plain = wanted.lstrip("-")  # of an option, which may be named with one dash as well as with two
    near = [name for name in known if name.lstrip("-").startswith(plain)] or get_close_matches(wanted, known, n=1)
    return f"; did you mean {near[0]}?" if near else ""
