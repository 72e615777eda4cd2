"""Runs what a hostile file is given to, in this process of its own, and prints how much memory that took.

    python hostile_file.py LINES

Each of LINES, a JSON list, is a command line of `reenact`. Printed is a JSON list: status, what is printed, and the
peak memory of this process so far [MB], after each.
"""

import contextlib
import io
import json
import shlex
import sys
from pathlib import Path

from pipeline.cli import app


def run(line: str) -> tuple[int, str, float]:
    """Run a command line; returns its status, what it says on standard error, and the peak memory so far [MB]."""
    printed, said, status = io.StringIO(), io.StringIO(), -1
    with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(said):
        try:
            app.main(shlex.split(line))
        except SystemExit as end:
            status = int(end.code or 0)
    return status, said.getvalue() + printed.getvalue(), peak_mb()


def peak_mb() -> float:
    """Return the peak memory of this process [MB]; `ru_maxrss` would begin with the parent's."""
    lines = Path("/proc/self/status").read_text().splitlines()
    (peak,) = (line for line in lines if line.startswith("VmHWM:"))
    return int(peak.split()[1]) / 1024


if __name__ == "__main__":
    print(json.dumps([run(line) for line in json.loads(sys.argv[1])]))
