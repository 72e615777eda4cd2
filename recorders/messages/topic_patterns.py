"""Patterns of topics, such as `/hand/*`: which topics they choose."""

from collections.abc import Collection, Iterable
from fnmatch import fnmatchcase

from recorders.errors import LogError
from recorders.text.wording import names_text


def matches(topic: str, patterns: Iterable[str]) -> bool:
    """Whether a topic is named by one of the patterns; `*` also stands for names with `/` between them."""
    return any(topic == pattern or fnmatchcase(topic, pattern) for pattern in patterns)


def chosen(patterns: Collection[str], topics: Collection[str], *, option: str) -> frozenset[str]:
    """Return the topics that patterns name.

    Raises
    ------
    LogError
        If a pattern names none: a slip of the pen would else leave something out in silence.

    Examples
    --------
    >>> sorted(chosen(["/hand/*"], ["/hand/left/target", "/hand/right/target", "/tf"], option="--topic"))
    ['/hand/left/target', '/hand/right/target']
    """
    there = frozenset(topics)
    named = there.intersection(patterns)
    for pattern in sorted(frozenset(patterns) - named):
        matched = frozenset(topic for topic in there if fnmatchcase(topic, pattern))
        if not matched:
            found = names_text(sorted(topics)) or "none"
            raise LogError(f"{option}: no topic {pattern} in the logs; there are: {found}")
        named |= matched
    return named
