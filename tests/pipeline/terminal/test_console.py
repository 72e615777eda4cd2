"""What is printed for a reader who has gone ends no work."""

import os
import subprocess
import sys

_SAYS = """
from pipeline.terminal import console

with console.progress("work") as advance:
    for number in range(3):
        console.notice(f"line {number}")
        advance(number / 3)
print("done")
"""


def test_a_reader_of_the_lines_who_goes_away_ends_no_work() -> None:
    reader, lines = os.pipe()
    os.close(reader)
    try:
        run = subprocess.run(
            [sys.executable, "-c", _SAYS], stdout=subprocess.PIPE, stderr=lines, text=True, check=False
        )
    finally:
        os.close(lines)
    assert (run.returncode, run.stdout) == (0, "done\n")
