"""Counts what is refused of the network and logs each reason once, whatever strangers send."""

import logging
from collections import Counter

from recorders.text.once import OnceWarner

logger = logging.getLogger(__name__)

_MAX_REASONS = 1000  # anyone may publish on any key: the reports must not fill the memory
_MAX_LINE = 1000  # nor may a single line of it [characters]


class Refusals:
    """Refused messages by topic and reason, of which each is logged once.

    Attributes
    ----------
    counts : counter of str
        How many messages were refused, by topic and reason.
    """

    def __init__(self) -> None:
        # One more than the reasons: "other topics".
        self._warnings = OnceWarner(logger, limit=_MAX_REASONS + 1, longest=_MAX_LINE)
        self.counts: Counter[str] = Counter()

    def count(self, topic: str, reason: str) -> None:
        """Count a message that is refused, and report it if it is the first of its kind."""
        if len(self.counts) >= _MAX_REASONS and f"{topic}: {reason}" not in self.counts:
            topic, reason = "other topics", "refused"
        self.counts[f"{topic}: {reason}"] += 1
        self.report(f"refused a message on {topic}: {reason}")

    def report(self, line: str) -> None:
        """Log a line once, as anybody may cause it again and again."""
        self._warnings.warn(line)
