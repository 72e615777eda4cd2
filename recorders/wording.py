"""Words of error lines: values and kinds of value as whoever wrote a file knows them, with nothing of Python's."""

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

    Bytes read as text, with whatever is no ASCII spelt out.
    """
    if value is None:
        return "nothing"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, dict | list):
        return f"{kind_text(type(value))} of {len(value)}"
    try:
        text = repr(bytes(value))[1:] if isinstance(value, bytes | bytearray | memoryview) else repr(value)
    except ValueError:  # a whole number of thousands of digits
        return f"{kind_text(type(value))}, a huge one"
    return text if len(text) <= limit else f"{text[: limit - 1]}…"
