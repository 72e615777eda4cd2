"""Counts what is refused of the network and reports each reason once, whatever strangers send."""

from collections import Counter
from collections.abc import Callable

from recorders.text.wording import escape_control

_MAX_REASONS = 1000  # anyone may publish on any key: the reports must not fill the memory
_MAX_LINE = 1000  # nor may a single line of it [characters]


class Refusals:
    """Refused messages by topic and reason, of which each is reported once.

    Parameters
    ----------
    say : callable
        Told of each, in one line.

    Attributes
    ----------
    counts : counter of str
        How many messages were refused, by topic and reason.
    """

    def __init__(self, say: Callable[[str], None]) -> None:
        self._say = say
        self._reported: set[str] = set()
        self.counts: Counter[str] = Counter()

    def count(self, topic: str, reason: str) -> None:
        """Count a message that is refused, and report it if it is the first of its kind."""
        if len(self.counts) >= _MAX_REASONS and f"{topic}: {reason}" not in self.counts:
            topic, reason = "other topics", "refused"
        self.counts[f"{topic}: {reason}"] += 1
        self.report(f"refused a message on {topic}: {reason}")

    def report(self, line: str) -> None:
        """Report a line once, as anybody may cause it again and again."""
        line = escape_control(line[:_MAX_LINE])
        if line not in self._reported and len(self._reported) < _MAX_REASONS + 1:  # one more: "other topics"
            self._reported.add(line)
            self._say(line)
