"""Processor time of a process and of all that it started, as Linux counts it."""

import os
from pathlib import Path

_TICK_S = 1.0 / os.sysconf("SC_CLK_TCK")


def processor_time_s(pid: int, *, named: str = "") -> float:
    """Return the time of a process and of those below it [s] that run now; only of those whose command has a word."""
    parents, times, commands = {}, {}, {}
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            fields = (folder / "stat").read_text().rpartition(")")[2].split()
            commands[int(folder.name)] = (folder / "cmdline").read_text(errors="replace")
        except (FileNotFoundError, ProcessLookupError):
            continue
        parents[int(folder.name)] = int(fields[1])
        times[int(folder.name)] = _TICK_S * (int(fields[11]) + int(fields[12]))
    found, below = 0.0, {pid}
    while below:
        found += sum(times.get(one, 0.0) for one in below if named in commands.get(one, ""))
        below = {one for one, parent in parents.items() if parent in below}
    return found
