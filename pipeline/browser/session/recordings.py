"""Recordings from the page: the usual recorder in a process of its own, and what is in the folder of logs."""

import json
import logging
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.browser.session.controllers import Place
from pipeline.browser.session.drive import Drive
from pipeline.browser.session.keys import LED
from pipeline.browser.session.recorded_motion import write_episode
from pipeline.deployment.verb_process import VerbProcess
from recorders.errors import LogError, ReenactError
from recorders.messages.topics import SESSION_PHASE
from recorders.nodes.keys import node_key, node_name
from recorders.wire.keys.namespace import control_key
from recorders.writing.part_file import part_of

logger = logging.getLogger(__name__)

_RECORDER = "page"
_ARRIVAL_S = 10.0


@dataclass(frozen=True)
class Recording:
    """A recording that is under way.

    Attributes
    ----------
    name : str
        What it is to be called.
    process : VerbProcess
        The recorder.
    log : Path
        What that writes.
    first_ns : int
        Stamp of the last tick before it began [ns].
    """

    name: str
    process: VerbProcess
    log: Path
    first_ns: int


class Recordings:
    """Records the session, and lists the logs of a folder.

    Parameters
    ----------
    place : Place
        Where the nodes meet.
    drive : Drive
        Whose ticks are recorded.
    folder : Path
        For the logs; made with the first of them.

    Attributes
    ----------
    place : Place
        Where the nodes meet.
    folder : Path
        For the logs.
    under_way : Recording or None
        The one that is under way.
    """

    def __init__(self, place: Place, drive: Drive, folder: Path) -> None:
        self.place, self._drive, self.folder = place, drive, folder
        self._begun = 0
        self.under_way: Recording | None = None

    def logs(self) -> tuple[str, ...]:
        """Return the names of the logs, in order."""
        return tuple(sorted(path.stem for path in self.folder.glob("*.mcap")))

    def path(self, name: str) -> Path:
        """Return where the log of a name is; raises LogError where the folder has none of it."""
        if name not in self.logs():
            raise LogError(f"expected the name of a log in {self.folder}, found {name!r:.60}")
        return self._file(name)

    def begin(self, name: str) -> None:
        """Begin a recording of a name, or one with a number behind it where there is such a log already.

        Raises
        ------
        LogError
            If one is under way, nothing is asked of the robot, or the name is none.
        WireError
            If the recorder does not begin.
        """
        if self.under_way is not None:
            raise LogError(f"expected none under way, found the recording {self.under_way.name}")
        if self._drive.last_stamp_ns is None:
            raise LogError("expected a robot that is led, found nothing asked of it: drag a handle or choose a motion")
        free = self._free(name)
        self._begun += 1
        log = self.place.folder / f"recorded_{self._begun}.mcap"
        where = (*self.place.arguments, "--name", _RECORDER)
        leave_out = ("--exclude", f"{LED}/*", "--exclude", SESSION_PHASE)
        process = VerbProcess(
            self.place.folder, "record", "--out", log, *where, *leave_out, name=f"record_{self._begun}"
        )
        try:
            self.place.await_token(node_key(self.place.namespace, "recorder", _RECORDER, "alive"), process)
        except BaseException:
            process.stop()
            raise
        self._drive.begin_figures()
        last_ns = self._drive.last_stamp_ns
        self.under_way = Recording(free, process, log, 0 if last_ns is None else last_ns + 1)

    def end(self) -> Path:
        """End the recording that is under way, and return its log.

        Raises
        ------
        LogError
            If none is under way, or it is not whole; what the recorder wrote then stays in the folder.
        """
        recording, self.under_way = self.under_way, None
        if recording is None:
            raise LogError("expected a recording under way, found none")
        last_ns = self._drive.last_stamp_ns or 0
        self._await_arrival()
        self.folder.mkdir(parents=True, exist_ok=True)
        try:
            return self._written(recording, last_ns)
        except ReenactError as error:
            raise LogError(f"{error}{self._left(recording)}") from error

    def close(self) -> None:
        """End a recording that is under way, and keep what there is of it."""
        if self.under_way is not None:
            log = self.end()
            logger.info(f"the recording that was under way is in {log}")

    def _written(self, recording: Recording, last_ns: int) -> Path:
        """End the recorder, and return the episode of what it recorded."""
        if recording.process.stop(signal.SIGINT):
            raise LogError(f"{recording.name}: the recorder failed: {recording.process.complaint()}")
        out = self._file(recording.name)
        write_episode(
            recording.log,
            out,
            self._drive.robot,
            first_ns=recording.first_ns,
            last_ns=last_ns,
            notes={"name": recording.name, "robot": self._drive.robot.name},
        )
        recording.log.unlink(missing_ok=True)
        return out

    def _left(self, recording: Recording) -> str:
        """Move what a recorder wrote into the folder, and return the end of a line that says where it is."""
        raw = self._file(self._free(f"{recording.name}_raw"))
        for left, kept in ((recording.log, raw), (part_of(recording.log), part_of(raw))):
            if left.exists():
                shutil.move(left, kept)
                return f"; all that was recorded is in {kept}"
        return ""

    def _await_arrival(self) -> None:
        """Wait until the recorder answers: what was published before has come there before the question."""
        key = control_key(self.place.namespace, _RECORDER, "status")
        for _ in self.place.session.get(key, timeout=_ARRIVAL_S):
            pass

    def _file(self, name: str) -> Path:
        return self.folder / f"{name}.mcap"

    def _free(self, name: str) -> str:
        """Return a name that no log has."""
        return free_path(self._file(visible_name(name.strip() or "demonstration"))).stem


def visible_name(text: str) -> str:
    """Return a text as the name of a file that is listed, without what begins a hidden one or an option.

    Raises
    ------
    LogError
        If nothing is left of it.
    """
    name = node_name(text).lstrip("._-")
    if not name:
        raise LogError(f"name: expected letters from a to z or digits, found {text!r:.60}")
    return name


def free_path(path: Path) -> Path:
    """Return a path, with a number behind its name if that is taken."""
    number, free = 1, path
    while free.exists():
        number += 1
        free = path.with_name(f"{path.stem}_{number}{path.suffix}")
    return free


def evaluated(controller: Path, log: Path) -> dict[str, Any]:
    """Return what `reenact evaluate` finds of a controller on a log; in a process of its own, as it computes.

    Raises
    ------
    LogError
        If it fails, with its own line.
    """
    return json_of("evaluate", controller, log, failure=LogError)


def json_of(verb: str, *arguments: object, failure: Callable[[str], Exception]) -> dict[str, Any]:
    """Return what a verb of ours prints with `--json`, or raise `failure` of its last line."""
    done = subprocess.run(  # noqa: S603  # our own program, no shell
        [sys.executable, "-m", "pipeline", verb, *map(str, arguments), "--json"],
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        lines = done.stderr.strip().splitlines()
        raise failure((lines[-1] if lines else f"{verb} failed").removeprefix("reenact: "))
    found: dict[str, Any] = json.loads(done.stdout)
    return found
