"""Lines that anybody may cause again and again, each logged once and only so many of them."""

import logging

from recorders.text.wording import escape_control

logger = logging.getLogger(__name__)


class OnceWarner:
    """Logs a warning the first time.

    Parameters
    ----------
    logger : logging.Logger
        Logger of the module that warns.
    limit : int
        Number of different lines; all others are dropped.
    longest : int, optional
        Characters of a line.
    """

    def __init__(self, logger: logging.Logger, *, limit: int, longest: int | None = None) -> None:
        self._logger = logger
        self._limit = limit
        self._longest = longest
        self._logged: set[str] = set()

    def warn(self, line: str, *, kind: str | None = None) -> None:
        """Log a line as a warning, unless it has been logged, or another of its kind has."""
        line = escape_control(line[: self._longest])
        kind = line if kind is None else kind
        if kind not in self._logged and len(self._logged) < self._limit:
            self._logged.add(kind)
            self._logger.warning(line)
