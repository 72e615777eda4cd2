"""A module as the child of another process: it ends when its parent does, however that ended; to be run as a module.

Its standard input is a pipe that the parent holds open and writes nothing to. The system closes the parent's end even
where the parent was killed, and that is all the child needs to know, on any system.
"""

import os
import runpy
import signal
import sys
import threading
import time

PATIENCE_S = 10.0
"""How long a child may take to end by itself once its parent has [s]."""

_STDIN = 0


def command(module: str, *arguments: str) -> list[str]:
    """Return the command line that runs a module as a child; its standard input is to be a pipe."""
    return [sys.executable, "-m", __name__, module, *arguments]


def _end_with_parent() -> None:
    """Wait until the parent has ended, and end this process by a signal; by force, if that does not help."""
    while os.read(_STDIN, 1):
        pass
    os.kill(os.getpid(), signal.SIGTERM)
    time.sleep(PATIENCE_S)
    os.kill(os.getpid(), signal.SIGKILL)


def main() -> None:
    """Run the module that the first argument names, with the others as its own."""
    threading.Thread(target=_end_with_parent, name="parent", daemon=True).start()
    del sys.argv[0]
    runpy.run_module(sys.argv[0], run_name="__main__", alter_sys=True)


if __name__ == "__main__":
    main()
