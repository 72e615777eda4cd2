"""The nodes of a soak, each in a process of its own: recorder, robot, controller, learner, and who drives them."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

import zenoh
from processes import command, reenact

from recorders.nodes.search import find_nodes
from recorders.wire.keys.namespace import DEFAULT_NAMESPACE

HERE = Path(__file__).parent
RECORDING, PART_SIZE = "soak.mcap", "256MB"
_APPEAR_S, _END_S = 300.0, 300.0
_LOOK_S = 0.2


@dataclass(frozen=True)
class SoakConfig:
    """How robot, controller, learner and recorder are run, and for how long.

    Parameters
    ----------
    hours : float
        How long [h]: in the robot's time, or with `real_time` on the wall.
    rate_hz : float
        Ticks, and states of the robot, in a second of that time [Hz].
    real_time : bool
        Whether the robot's time runs with the clock on the wall, and Drake simulates it; else a robot without Drake
        steps as fast as it is commanded.
    every_s : float
        How often the processes are looked at [s].
    """

    hours: float = 24.0
    rate_hz: float = 20.0
    real_time: bool = False
    every_s: float = 5.0

    @property
    def ticks(self) -> int:
        """How many ticks there are in these hours, if none comes late."""
        return round(self.hours * 3600.0 * self.rate_hz)

    @property
    def mode(self) -> str:
        """The mode of `tick_driver.py`."""
        return "real-time" if self.real_time else "lockstep"


def learned_controller(folder: Path) -> Path:
    """Explore and train the controller that is served; returns its file."""
    steps = (
        ("explore", "--motion", "volume", "--duration", 60, "--out", "volume.mcap", "--overwrite"),
        ("train", "volume.mcap", "--rule", "forward-inverse", "--out", "controller.npz", "--overwrite"),
    )
    for step in steps:
        done = reenact(*step, cwd=folder, timeout_s=1800.0)
        if done.returncode:
            raise SystemExit(f"reenact {step[0]}: {done.stderr}")
    return folder / "controller.npz"


class Nodes:
    """Processes by the kind of node that each is, as its status has it."""

    def __init__(self, folder: Path, endpoint: str, stack: ExitStack) -> None:
        self._folder, self._endpoint, self._stack = folder, endpoint, stack
        self.processes: dict[str, subprocess.Popen[str]] = {}

    def start_verb(self, kind: str, verb: str, *options: object, listens: bool = False) -> None:
        """Start a verb of the program."""
        there = "--listen" if listens else "--connect"
        self._start(kind, [*command(verb, *options), there, self._endpoint])

    def start_script(self, kind: str, script: str, *arguments: object) -> None:
        """Start a script beside this one."""
        self._start(kind, [sys.executable, str(HERE / script), self._endpoint, *map(str, arguments)])

    def output(self, kind: str) -> str:
        """Return what a process has printed."""
        return (self._folder / f"{kind}.out").read_text()

    def check(self) -> None:
        """End the program if a process has ended that should not have, or failed."""
        for kind, process in self.processes.items():
            if process.poll() not in ((None, 0) if kind == "explorer" else (None,)):
                self._abort()
                errors = (self._folder / f"{kind}.err").read_text()
                raise SystemExit(f"{kind} has ended with status {process.returncode}: {errors[-2000:]}")

    def _abort(self) -> None:
        """End all processes, having each write into its file of errors where its threads stand."""
        for process in self.processes.values():
            process.send_signal(signal.SIGABRT)
            process.wait(timeout=_END_S)

    def await_kinds(self, session: zenoh.Session) -> None:
        """Wait until every process is found as a node: its subscriptions are there then."""
        deadline_s = time.monotonic() + _APPEAR_S
        while not set(self.processes) <= {status.kind for status in find_nodes(session, namespace=DEFAULT_NAMESPACE)}:
            self.check()
            if time.monotonic() > deadline_s:
                raise SystemExit(f"not all of {', '.join(self.processes)} have appeared within {_APPEAR_S:g} s")
            time.sleep(_LOOK_S)

    def end(self, kind: str) -> int:
        """End a process as Ctrl-C's sibling SIGTERM does, and return its exit status."""
        process = self.processes.pop(kind)
        process.terminate()
        return process.wait(timeout=_END_S)

    def _start(self, kind: str, arguments: list[str]) -> None:
        files = [self._stack.enter_context((self._folder / f"{kind}.{end}").open("w")) for end in ("out", "err")]
        process = subprocess.Popen(
            arguments,
            cwd=self._folder,
            env=os.environ | {"PYTHONFAULTHANDLER": "1"},
            stdin=subprocess.DEVNULL,
            stdout=files[0],
            stderr=files[1],
            text=True,
        )
        self._stack.callback(process.kill)
        self.processes[kind] = process


@contextmanager
def running_nodes(folder: Path, endpoint: str, config: SoakConfig) -> Iterator[Nodes]:
    """Start recorder, robot, controller and learner; the first is the router of all, and must be there before them."""
    with ExitStack() as stack:
        nodes = Nodes(folder, endpoint, stack)
        nodes.start_verb("recorder", "record", "--out", RECORDING, "--split", PART_SIZE, "--json", listens=True)
        if config.real_time:
            nodes.start_verb("robot", "robot", "--real-time", "--rate", config.rate_hz)
        else:
            nodes.start_script("robot", "kinematic_robot.py", config.rate_hz)
        nodes.start_verb("controller", "serve", "controller.npz", "--json")
        nodes.start_verb(
            "learner", "learn", "--live", "--robot", "asimo", "--out", "learned.npz", "--overwrite", "--json"
        )
        yield nodes
