"""Work that is done again and again on a thread of its own."""

import threading
from collections.abc import Callable


class PeriodicThread:
    """Calls a function until it is stopped. An interpreter that ends does not wait for it.

    Parameters
    ----------
    action : callable
        What is done; returns the time until it is to be done again [s].
    name : str
        Name of the thread.
    first_s : float
        Time until it is done first [s].
    """

    def __init__(self, action: Callable[[], float], *, name: str, first_s: float) -> None:
        self._action = action
        self._first_s = first_s
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Let what is being done come to its end, and do it no more."""
        self._stopped.set()
        self._thread.join()

    def _run(self) -> None:
        wait_s = self._first_s
        while not self._stopped.wait(wait_s):
            wait_s = self._action()
