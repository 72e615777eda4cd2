"""The tally of a recovery: messages saved from a log, and messages known to be lost."""

from collections import Counter
from dataclasses import dataclass, field

from recorders.mcap_format.channels import DeclaredChannel
from recorders.recovery.salvage import LogSurvey, Salvaged

_UNDECLARED = "on channels that are not declared"


@dataclass
class Tally:
    """Counts the messages that are saved.

    Attributes
    ----------
    saved : Counter
        Messages by topic.
    unprotected : int
        How many of them stand in no chunk with a CRC.
    undeclared : int
        Messages that cannot be saved, as their channel is unknown.
    missing : Counter
        Messages by topic whose numbers are missing at damage.
    """

    saved: Counter[str] = field(default_factory=Counter)
    unprotected: int = 0
    undeclared: int = 0
    missing: Counter[str] = field(default_factory=Counter)
    _last: dict[DeclaredChannel, tuple[int, int]] = field(default_factory=dict)  # span and sequence

    def add(self, message: Salvaged) -> None:
        """Take in a message."""
        channel = message.channel
        if channel is None:
            self.undeclared += 1
            return
        self.saved[channel.topic] += 1
        self.unprotected += not message.protected
        span, sequence = self._last.get(channel, (message.span, message.sequence))
        if span != message.span and message.sequence > sequence + 1:
            self.missing[channel.topic] += message.sequence - sequence - 1
        self._last[channel] = message.span, message.sequence

    def lost(self, found: LogSurvey) -> tuple[Counter[str] | None, bool]:
        """Return how many messages of each topic are lost, and whether these are all.

        The log's own counts, of its summary or manifest, are used; without them the numbers missing at damage, and
        what cannot be saved; and without those nothing does.
        """
        counts = found.stated_counts
        if counts is None and isinstance(found.manifest.get("counts"), dict):
            counts = Counter({topic: n for topic, n in found.manifest["counts"].items() if type(n) is int})
        if counts is not None:  # where every message is saved, they may be on other topics than is stated
            return (counts - self.saved if self.saved.total() < counts.total() else Counter()), True
        whole = found.finished and not found.damage
        missing = self.missing + Counter({_UNDECLARED: self.undeclared})
        return (missing, whole) if missing or whole else (None, False)
