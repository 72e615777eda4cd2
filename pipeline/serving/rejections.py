"""Reasons for which a served controller rejects messages, and their counts."""

from collections import Counter
from collections.abc import Callable
from enum import StrEnum

from recorders.errors import MessageError, OutOfRange
from recorders.messages.record import RecordedMessage
from recorders.text.wording import escape_control
from recorders.ticks.stamp_joiner import RejectionError

_MAX_LINE = 300


class Rejection(StrEnum):
    """Reason for rejecting a message; the last good command is held."""

    STALE = "stale"  # not newer than the last targets that were accepted
    AHEAD = "ahead"  # much later than the time that has passed since then
    REPEATED = "repeated"  # the same topic and stamp as one that waits for its partner
    WRONG_TYPE = "wrong type"
    UNDECODABLE = "undecodable"
    TOO_LARGE = "too large"
    NOT_FINITE = "not finite"
    OUT_OF_RANGE = "out of range"
    WRONG_JOINTS = "wrong joints"
    BEYOND = "beyond"  # farther from what was explored than is served, if that was asked for
    NOT_MEASURED = "not measured"  # the posture to start from, if commands are to move the joints slowly
    NO_TIME = "no time"  # before the first message of /clock, if that is the time
    NO_PARTNER = "no partner"  # the rest of its tick had not come when a newer tick was complete


class Rejections:
    """Counts rejected messages by reason, and reports the first of each.

    Parameters
    ----------
    report : callable
        Given the lines to report.

    Attributes
    ----------
    last : str
        Why the last message was rejected, in printable characters.
    """

    def __init__(self, report: Callable[[str], None]) -> None:
        self._report = report
        self._counts: Counter[str] = Counter()
        self.last = ""

    def add(self, reason: str, line: str) -> None:
        """Count a message, and remember the line that names why it is not served."""
        self._counts[str(reason)] += 1
        self.last = escape_control(line[:_MAX_LINE])  # it may quote what came from the network
        if self._counts[reason] == 1:
            self._report(f"refused, {reason}: {self.last}")

    def counts(self) -> dict[str, int]:
        """Return how many messages were rejected, by reason; may be called from any thread."""
        return dict(self._counts)


def undecodable(record: RecordedMessage, error: MessageError) -> RejectionError:
    """Return the error of bytes that are no message of the topic's type."""
    return RejectionError(Rejection.UNDECODABLE, f"{record.topic}: {error}")


def wrong_type(record: RecordedMessage, expected: str) -> RejectionError:
    """Return the error of a message whose publisher names another type."""
    return RejectionError(Rejection.WRONG_TYPE, f"{record.topic}: expected {expected}, found {record.type!r:.80}")


def unusable(record: RecordedMessage, error: OutOfRange) -> RejectionError:
    """Return the error of numbers that are not finite, or cannot be the robot's."""
    kind = Rejection.OUT_OF_RANGE if error.finite else Rejection.NOT_FINITE
    return RejectionError(kind, f"{record.topic}: {error}")
