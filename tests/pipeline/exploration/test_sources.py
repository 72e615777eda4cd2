"""Exploration sources: our own, and one from outside the package, which is explored as ours are."""

import json
from collections.abc import Iterator
from pathlib import Path

import pytest
import toy_source
from installed import installed
from typer.testing import CliRunner

from pipeline.cli.app import app
from pipeline.exploration.contract import DrawnMotionContract
from pipeline.exploration.source import SOURCES, source
from pipeline.exploration.sources import volume
from recorders.errors import ConfigError
from recorders.reading.reader import LogReader


@pytest.fixture(scope="module", autouse=True)
def registered(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Install the source, and one that cannot be loaded."""
    entries = {"sweep": "SOURCE", "broken": "NONE"}
    with installed(tmp_path_factory.mktemp("site"), toy_source, SOURCES, group="reenact.explorations", entries=entries):
        yield


class TestVolume(DrawnMotionContract):
    source = volume.SOURCE


class TestSweep(DrawnMotionContract):
    source = toy_source.SOURCE


def test_it_is_explored(tmp_path: Path) -> None:
    options = ("--duration", "1.5", "--tick-rate", "10", "--seed", "3", "--out", str(tmp_path / "log.mcap"), "--json")
    found = CliRunner().invoke(app, ["explore", "--motion", "sweep", *options])
    assert found.exit_code == 0, found.output
    assert json.loads(found.stdout)["ticks"] == 16
    assert LogReader(tmp_path / "log.mcap").manifest["motion"]["name"] == "sweep"


def test_a_source_is_looked_up_and_never_imported_by_name() -> None:
    assert {"volume", "sweep", "broken"} <= set(SOURCES.names())
    with pytest.raises(ConfigError, match="motion 'toy_source' has its own duration and tick rate"):
        source("toy_source", duration_s=2.0)
    with pytest.raises(ConfigError, match="exploration source broken: cannot be loaded"):
        source("broken")
