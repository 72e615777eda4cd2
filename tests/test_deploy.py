"""The image and the units under `data/deploy` are what their tools take for right, and run commands that there are."""

import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from pipeline.cli.app import app

DEPLOY = Path(__file__).parent.parent / "data" / "deploy"
UNITS = sorted(DEPLOY.glob("*.service"))


def tool(name: str) -> str:
    path = shutil.which(name, path=f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}")
    if path is None:
        reason = f"{name} is not installed"
        raise (
            pytest.fail.Exception(reason)
            if os.environ.get("REENACT_TEST_EVERYTHING")
            else pytest.skip.Exception(reason)
        )
    return path


def test_the_dockerfile_passes_its_linter() -> None:
    run = subprocess.run([tool("hadolint"), DEPLOY / "Dockerfile"], capture_output=True, text=True, check=False)
    assert (run.returncode, run.stdout) == (0, ""), run.stderr


@pytest.mark.parametrize("unit", UNITS, ids=lambda unit: unit.stem)
def test_systemd_takes_the_unit(unit: Path, tmp_path: Path) -> None:
    executable = tmp_path / "reenact"
    executable.write_text("#!/bin/sh\n")
    executable.chmod(0o755)
    copy = tmp_path / unit.name
    copy.write_text(unit.read_text().replace("/opt/reenact/bin/reenact", str(executable)))
    command = [tool("systemd-analyze"), "verify", "--man=no", "--recursive-errors=no", copy]
    run = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (run.returncode, run.stdout + run.stderr) == (0, "")


@pytest.mark.parametrize("file", [*UNITS, DEPLOY / "Dockerfile"], ids=lambda file: file.name)
def test_every_option_is_one_of_the_verb(file: Path) -> None:
    text = file.read_text()
    commands = re.findall(r"^ExecStart=\S+/reenact (.*)$", text, re.M)
    commands += [" ".join(words[1:]) for words in _exec_form(text)]
    assert commands
    for command in commands:
        verb, *words = shlex.split(command)
        page = CliRunner().invoke(app, [verb, "--help"])
        assert page.exit_code == 0
        assert [word for word in words if word.startswith("--") and word not in page.output] == []


def _exec_form(text: str) -> list[list[str]]:
    found = re.findall(r"^HEALTHCHECK .*CMD \[(.*)\]$", text, re.M)
    return [re.findall(r'"([^"]*)"', words) for words in found]


def test_nothing_listens_beyond_loopback() -> None:
    assert [unit.name for unit in UNITS if "0.0.0.0" in unit.read_text() or "--listen" in unit.read_text()] == []
