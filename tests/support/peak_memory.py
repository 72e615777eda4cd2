"""The peak memory of a process of its own."""

import subprocess
import sys

_REPORT = "\nprint(open('/proc/self/status').read())"  # not ru_maxrss, which begins with the parent's


def peak_memory_mb(code: str, *, text: str = "") -> float:
    """Run Python code, with `text` as its standard input, in a process of its own; return its peak memory [MB]."""
    done = subprocess.run([sys.executable, "-c", code + _REPORT], input=text, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    (peak,) = (line for line in done.stdout.splitlines() if line.startswith("VmHWM:"))
    print(peak)
    return int(peak.split()[1]) / 1024
