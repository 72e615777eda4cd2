"""What the packages log is a bare line on standard error while a verb runs, and nothing of theirs otherwise."""

import json
import logging
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from pipeline.cli.app import app
from pipeline.terminal.log_lines import logging_to_terminal
from recorders.reading.parts import one_session, part_path
from recorders.writing.writer import LogWriter

PACKAGES = ("pipeline", "replay", "recorders")


@pytest.mark.parametrize("package", PACKAGES)
def test_lines_are_printed_bare_and_escaped_while_the_block_runs(
    package: str, capsys: pytest.CaptureFixture[str]
) -> None:
    logger = logging.getLogger(f"{package}.some.module")
    with logging_to_terminal():
        logger.info("first [bold]line[/bold] %s %d")
        logger.warning("\x1b[2Jsecond\nof them")
        logger.debug("nobody asked for this")
    logger.warning("after it")
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err == "first [bold]line[/bold] %s %d\n\\x1b[2Jsecond\\nof them\n"


def test_a_verb_prints_on_standard_error_alone_and_leaves_logging_as_it_was(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    part = part_path(tmp_path / "session.mcap", 1)
    with LogWriter(part, manifest={"part": {"session": "a", "number": 1, "more": False}}):
        pass
    loggers = [logging.getLogger(package) for package in PACKAGES]
    before = [(logger.level, list(logger.handlers)) for logger in loggers]
    run = CliRunner().invoke(app, ["info", part.name, "--json"])
    assert run.stderr == f"{part.name} is one part of a session, taken alone; session.mcap beside it names them all\n"
    assert json.loads(run.stdout)["messages"] == 0
    assert [(logger.level, list(logger.handlers)) for logger in loggers] == before
    assert one_session([part]) == part


def test_a_program_that_asks_for_no_log_sees_none() -> None:
    """As Python's logging does it: a library prints nothing by itself, and all of it for whoever configures logging."""
    program = (
        "import logging, pipeline, replay, recorders\n"
        "loggers = [logging.getLogger(f'{name}.x') for name in ('pipeline', 'replay', 'recorders')]\n"
        "[logger.warning('quiet') for logger in loggers]\n"
        "logging.basicConfig(format='%(name)s %(message)s')\n"
        "[logger.warning('heard') for logger in loggers]\n"
    )
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert run.stderr.splitlines() == ["pipeline.x heard", "replay.x heard", "recorders.x heard"]
