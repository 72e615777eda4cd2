"""Lines that anybody may cause again and again, each logged once and only so many of them."""

import logging

from recorders.text.wording import escape_control

logger = logging.getLogger(__name__)


class OnceWarner:
    """Logs a line the first time, by default as a warning.

    Parameters
    ----------
    logger : logging.Logger
        Logger of the module that warns.
    limit : int
        Number of different lines; all others are dropped.
    longest : int, optional
        Characters of a line.
    level : int
        Level of the lines.
    """

    def __init__(
        self, logger: logging.Logger, *, limit: int, longest: int | None = None, level: int = logging.WARNING
    ) -> None:
        self._logger = logger
        self._level = level
        self._limit = limit
        self._longest = longest
        self._logged: set[str] = set()

    def warn(self, line: str, *, kind: str | None = None) -> None:
        """Log a line, unless it has been logged, or another of its kind has."""
        line = escape_control(line[: self._longest])
        kind = line if kind is None else kind
        if kind not in self._logged and len(self._logged) < self._limit:
            self._logged.add(kind)
            self._logger.log(self._level, line)
