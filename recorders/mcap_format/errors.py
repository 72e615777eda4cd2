"""The error for a log that is cut off or damaged: where, up to when it is good, and what to do about it."""

from pathlib import Path

from recorders.errors import LogError

_NS_PER_S = 1_000_000_000


class DamagedLog(LogError):
    """A log is not what its writer wrote.

    Attributes
    ----------
    offset : int
        Where the damage was found [bytes]; everything that was read before it is good.
    reason : str
        What is wrong there; empty for a log that is merely cut off.
    last_time_ns : int or None
        Log time of the last message before the damage [ns]; None if there is none, or nobody read messages.
    path : Path or None
        The log, once it is known.
    """

    def __init__(
        self, offset: int, reason: str = "", *, last_time_ns: int | None = None, path: Path | None = None
    ) -> None:
        self.offset = offset
        self.reason = reason
        self.last_time_ns = last_time_ns
        self.path = path
        super().__init__(self._text())

    def located(self, path: Path, last_time_ns: int | None = None) -> "DamagedLog":
        """Return the same error with the name of the log and the time up to which it is good."""
        return type(self)(self.offset, self.reason, last_time_ns=last_time_ns, path=path)

    def _text(self) -> str:
        text = self._what()
        if self.last_time_ns is not None:
            text += f"; the last good message is of {_seconds(self.last_time_ns)}"
        return text if self.path is None else f"{self.path}: {text}; `reenact recover` saves what is whole"

    def _what(self) -> str:
        if not self.reason:
            return f"the log is cut off at byte {self.offset}, before its end was written"
        return f"the log is damaged at byte {self.offset}: {self.reason}"


class TooLarge(DamagedLog):
    """Something in a log would take more memory than there is for it; it may be sound, and is passed over."""

    def _what(self) -> str:
        return f"too large to be read at byte {self.offset}: {self.reason}"


class Redeclared(DamagedLog):
    """A channel is declared as another than it was: its messages differ by their offsets alone."""


def damaged(offset: int, what: str) -> DamagedLog:
    """Return the error for a log in which something at `offset` is not what its writer wrote."""
    return DamagedLog(offset, what)


def cut_off(offset: int) -> DamagedLog:
    """Return the error for a log that ends too early."""
    return DamagedLog(offset)


def _seconds(time_ns: int) -> str:
    seconds, rest = divmod(time_ns, _NS_PER_S)
    return f"{seconds}.{rest:09d} s"
