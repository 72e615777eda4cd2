"""Log records of the three packages as lines on standard error, for as long as the command line runs a verb."""

import logging
from collections.abc import Iterator
from contextlib import contextmanager

from pipeline.terminal import console

_PACKAGES = ("pipeline", "replay", "recorders")


class _LineHandler(logging.Handler):
    """Prints the message of a record and nothing else.

    It takes no lock, as the console has one: a signal that ends the main thread while it prints must block no other.
    """

    def handle(self, record: logging.LogRecord) -> bool:
        """Print a record, whoever else prints."""
        self.emit(record)
        return True

    def emit(self, record: logging.LogRecord) -> None:
        """Print a record as one line."""
        console.notice(record.getMessage())


@contextmanager
def logging_to_terminal() -> Iterator[None]:
    """Print what the packages log, from INFO on, while the block runs."""
    handler = _LineHandler()
    loggers = [logging.getLogger(package) for package in _PACKAGES]
    levels = [logger.level for logger in loggers]
    for logger in loggers:
        logger.addHandler(handler)
        logger.setLevel(logging.INFO)
    try:
        yield
    finally:
        for logger, level in zip(loggers, levels, strict=True):
            logger.removeHandler(handler)
            logger.setLevel(level)
