"""A viewer without a window, in a process of its own, that keeps what it is sent."""

import subprocess
import time
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rerun.chunk import RrdReader

from recorders.rerun_scene.viewer import is_reachable, viewer_command, viewer_environment
from recorders.wire.loopback import free_endpoint


@dataclass(frozen=True)
class RerunServer:
    """Its URL, process id, and the file that is whole once it is stopped."""

    url: str
    pid: int
    path: Path


@contextmanager
def rerun_server(folder: Path) -> Iterator[RerunServer]:
    port = int(free_endpoint().rpartition(":")[2])
    path, home = folder / "kept.rrd", folder / "viewer-home"
    home.mkdir()
    command = viewer_command(port, "--save", str(path))
    url = f"rerun+http://127.0.0.1:{port}/proxy"
    with subprocess.Popen(
        command, env=viewer_environment(home), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    ) as process:
        try:
            deadline = time.monotonic() + 120
            while not is_reachable(url):
                assert process.poll() is None, "the viewer ended"
                assert time.monotonic() < deadline, "the viewer did not start"
                time.sleep(0.05)
            yield RerunServer(url, process.pid, path)
        finally:
            process.terminate()
            process.wait(timeout=120)


def rows(path: Path, entity: str, component: str, *, static: bool = False) -> list[Any]:
    """Return what a recording holds of a component, in order."""
    chunks = [c for c in _reader(path).stream() if c.entity_path == entity and c.is_static == static]
    batches = [c.to_record_batch() for c in chunks]
    return [row for batch in batches if component in batch.schema.names for row in batch.column(component).to_pylist()]


def entities(path: Path) -> set[str]:
    """Return the entities of a recording, and of its layout."""
    return {chunk.entity_path for chunk in _reader(path).stream()}


def _reader(path: Path) -> RrdReader:
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="RRD file has no footer")  # one that a viewer kept
        return RrdReader(path)
