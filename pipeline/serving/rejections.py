"""Why a served controller refuses a message, and in which words."""

from enum import StrEnum

from pipeline.robot.range_check import OutOfRange
from recorders.errors import MessageError
from recorders.messages.record import RecordedMessage


class Refusal(StrEnum):
    """Why a message is refused; the last good command is held."""

    STALE = "stale"  # not newer than the last targets that were accepted
    AHEAD = "ahead"  # much later than the time that has passed since then
    REPEATED = "repeated"  # the same topic and stamp as one that waits for its partner
    WRONG_TYPE = "wrong type"
    UNDECODABLE = "undecodable"
    TOO_LARGE = "too large"
    NOT_FINITE = "not finite"
    OUT_OF_RANGE = "out of range"
    WRONG_JOINTS = "wrong joints"
    NO_PARTNER = "no partner"  # the rest of its tick had not come when a newer tick was complete


class RefusedError(MessageError):
    """A message is not served; `reason` says why, the text what was expected and found."""

    def __init__(self, reason: Refusal, line: str) -> None:
        super().__init__(line)
        self.reason = reason


def undecodable(record: RecordedMessage, error: MessageError) -> RefusedError:
    """Return the error of bytes that are no message of the topic's type."""
    return RefusedError(Refusal.UNDECODABLE, f"{record.topic}: {error}")


def wrong_type(record: RecordedMessage, expected: str) -> RefusedError:
    """Return the error of a message whose publisher names another type."""
    return RefusedError(Refusal.WRONG_TYPE, f"{record.topic}: expected {expected}, found {record.type!r:.80}")


def unusable(record: RecordedMessage, error: OutOfRange) -> RefusedError:
    """Return the error of numbers that are not finite, or cannot be the robot's."""
    return RefusedError(Refusal.OUT_OF_RANGE if error.finite else Refusal.NOT_FINITE, f"{record.topic}: {error}")
