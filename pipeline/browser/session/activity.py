"""Work that takes a while, one after the other on a thread of its own, and what is to be read of it."""

import logging
import threading
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor

from recorders.errors import ReenactError

logger = logging.getLogger(__name__)


class Activity:
    """Does one thing after the other, and keeps why the last one failed.

    Attributes
    ----------
    doing : str
        What is done at the moment; empty if nothing is.
    failure : str
        Why the last thing failed; empty if it did not.
    """

    def __init__(self) -> None:
        self._executor = ThreadPoolExecutor(max_workers=1, thread_name_prefix="activity")
        self._lock = threading.Lock()
        self.doing = self.failure = ""

    def do(self, what: str, work: Callable[[], object]) -> "Future[None]":
        """Do something once all before it is done; a `ReenactError` or OSError of it is kept as text."""
        return self._executor.submit(self._do, what, work)

    def cancel(self) -> None:
        """Drop what has not begun."""
        self._executor.shutdown(wait=False, cancel_futures=True)

    def close(self) -> None:
        """Drop what has not begun, and wait for what has."""
        self._executor.shutdown(cancel_futures=True)

    def _do(self, what: str, work: Callable[[], object]) -> None:
        self.doing, self.failure = what, ""
        try:
            work()
        except (ReenactError, OSError) as error:
            self.failure = f"{what}: {error}"
        except Exception:
            self.failure = f"{what}: an error of this program; see the terminal"
            logger.exception(f"{what} failed")
        finally:
            self.doing = ""
