"""Patterns of topics, such as `/hand/*`: which topics they choose."""

from collections.abc import Collection, Iterable
from fnmatch import fnmatchcase

from recorders.errors import LogError
from recorders.wording import names_text


def matches(topic: str, patterns: Iterable[str]) -> bool:
    """Whether a topic is named by one of the patterns; `*` also stands for names with `/` between them."""
    return any(topic == pattern or fnmatchcase(topic, pattern) for pattern in patterns)


def chosen(patterns: Collection[str], topics: Collection[str], *, option: str) -> frozenset[str]:
    """Return the topics that patterns name.

    Raises
    ------
    LogError
        If a pattern names none: a slip of the pen would else leave something out in silence.
    """
    for pattern in sorted(patterns):
        if not any(matches(topic, (pattern,)) for topic in topics):
            found = names_text(sorted(topics)) or "none"
            raise LogError(f"{option}: no topic {pattern} in the logs; there are: {found}")
    return frozenset(topic for topic in topics if matches(topic, patterns))
