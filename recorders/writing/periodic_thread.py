"""Work that is done again and again on a thread of its own."""

import threading
from collections.abc import Callable


class PeriodicThread:
    """Calls a function until it is stopped. An interpreter that ends does not wait for it.

    Parameters
    ----------
    action : callable
        What is done.
    name : str
        Name of the thread.
    every_s : float
        Time until it is done first, and from the end of one time to the next [s].
    """

    def __init__(self, action: Callable[[], None], *, name: str, every_s: float) -> None:
        self._action = action
        self._every_s = every_s
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        try:
            self._thread.start()
        except BaseException:  # of a signal: the thread may run all the same
            self._stopped.set()
            raise

    def stop(self) -> None:
        """Let what is being done come to its end, and do it no more."""
        self._stopped.set()
        self._thread.join()

    def _run(self) -> None:
        while not self._stopped.wait(self._every_s):
            self._action()
