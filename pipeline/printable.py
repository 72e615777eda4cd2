"""Texts that come from anyone, on their way to a terminal: whatever it might obey is spelt out."""


def printable(text: str) -> str:
    """Return a text with everything that a terminal might obey, such as an escape, spelt out."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)
