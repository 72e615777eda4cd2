"""What is printed: for a reader who has gone, which ends no work, and how numbers are written."""

import json
import os
import subprocess
import sys

import pytest

from pipeline.terminal import console

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


def test_small_numbers_are_printed_to_three_digits_and_json_has_them_all(capsys: pytest.CaptureFixture[str]) -> None:
    result = {"large_cm": 1.2236, "small_cm": 0.020326648, "still_cm": 0.0, "back_cm": -0.1, "ticks": 3}
    console.show(result, as_json=False)
    printed = dict(line.split() for line in capsys.readouterr().out.splitlines())
    assert printed == {
        "large_cm": "1.22",
        "small_cm": "0.0203",
        "still_cm": "0.00",
        "back_cm": "-0.100",
        "ticks": "3",
    }
    console.show(result, as_json=True)
    assert json.loads(capsys.readouterr().out) == result
