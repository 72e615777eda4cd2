"""A coverage-guided fuzzer on the reader, for a bounded number of runs from a fixed seed."""

import subprocess
import sys
from pathlib import Path

import pytest
from every_record import write_every_record

HARNESS = Path(__file__).parents[2] / "support" / "fuzz_reader.py"
ROOT = Path(__file__).parents[3]
MEMORY_MB = 1024


@pytest.mark.parametrize(
    "runs", [4_000, pytest.param(500_000, marks=[pytest.mark.campaign, pytest.mark.timeout(7200)])]
)
def test_whatever_the_fuzzer_finds_is_our_error(tmp_path, runs):
    corpus = tmp_path / "corpus"
    corpus.mkdir()
    write_every_record(corpus / "every.mcap")
    write_every_record(corpus / "bare.mcap", crcs=False)  # lets the fuzzer get behind the CRCs
    options = [f"-runs={runs}", "-seed=1", "-max_len=8192", f"-rss_limit_mb={MEMORY_MB}", "-timeout=20"]
    # By a shell: a process that we start ourselves counts the most memory that we ever took as its own.
    fresh = ["sh", "-c", '"$@" & wait $!', "sh"]
    command = [*fresh, sys.executable, HARNESS, *options, f"-artifact_prefix={tmp_path}/", corpus]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, errors="replace")
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-4000:]
    assert f"Done {runs} runs" in done.stderr
