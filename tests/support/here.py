"""Runs `reenact` in the process of the tests: for what a process of its own would show no better, and later."""

import io
import signal
import subprocess
from contextlib import chdir, redirect_stderr, redirect_stdout
from pathlib import Path

from pipeline.cli import app


def reenact_here(*arguments: object, cwd: Path) -> subprocess.CompletedProcess[str]:
    """Run the command line in a folder, and return what a process of its own would have ended with and printed.

    What other threads of this process print meanwhile is in it: none may run a node that logs.
    """
    words = [*map(str, arguments)]
    out, err = (io.TextIOWrapper(io.BytesIO(), encoding="utf-8", write_through=True) for _ in range(2))
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)}
    try:
        with chdir(cwd), redirect_stdout(out), redirect_stderr(err):
            app.main(words)
    except SystemExit as end:
        status = end.code
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
    assert isinstance(status, int)
    return subprocess.CompletedProcess(words, status, *(stream.buffer.getvalue().decode() for stream in (out, err)))
