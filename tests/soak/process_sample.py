"""What a process takes at a moment: memory, descriptors, threads; read from /proc."""

from pathlib import Path
from typing import NamedTuple


class ProcessSample(NamedTuple):
    """What a process takes.

    Attributes
    ----------
    resident, anonymous : int
        Memory [bytes]: all that is in RAM, and what no file backs.
    descriptors, threads : int
        How many it has.
    """

    resident: int
    anonymous: int
    descriptors: int
    threads: int


def process_sample(pid: int) -> ProcessSample:
    """Look at a process."""
    folder = Path(f"/proc/{pid}")
    fields = dict(line.split(":", 1) for line in (folder / "status").read_text().splitlines())
    resident, anonymous = (int(fields[name].split()[0]) * 1024 for name in ("VmRSS", "RssAnon"))
    return ProcessSample(resident, anonymous, len(list((folder / "fd").iterdir())), int(fields["Threads"]))
