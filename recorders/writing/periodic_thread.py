"""Work that is done again and again on a thread of its own."""

import threading
from collections.abc import Callable


class PeriodicThread:
    """Calls a function from its start until it is stopped. An interpreter that ends does not wait for it.

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

    def start(self) -> None:
        """Begin; a start that the exception of a signal cuts short may have begun, and is to be stopped."""
        self._thread.start()

    def stop(self) -> None:
        """Let what is being done come to its end, and do it no more; one that was never started stays so."""
        self._stopped.set()
        if self._thread.is_alive():  # one that was cut short while it started may be about to begin
            self._thread.join()

    def _run(self) -> None:
        while not self._stopped.wait(self._every_s):
            self._action()
