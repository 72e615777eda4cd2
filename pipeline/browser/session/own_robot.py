"""The simulated robot as a process of its own, started again whenever it has ended."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Self

from pipeline.deployment.verb_process import IN_NAMESPACE, VerbProcess
from pipeline.robot.config import TOML_FILE, URDF_FILE, RobotConfig
from recorders.threads import background_thread

_LOOK_S = 0.2
_PAUSE_S = 1.0  # before it is started again


class OwnRobot:
    """Runs `reenact robot --real-time`, and whatever ends it runs it again, while the block of `running` runs.

    Parameters
    ----------
    robot : RobotConfig
        The robot.
    folder : Path
        For its files.
    endpoint, namespace : str
        Where it listens, and the first part of its keys.

    Attributes
    ----------
    report : str
        Why it ended the last time; empty if it never did.
    restarts : int
        How often it was started again.
    """

    def __init__(self, robot: RobotConfig, folder: Path, *, endpoint: str, namespace: str) -> None:
        self._folder = folder / "robot"
        self._folder.mkdir()
        (self._folder / TOML_FILE).write_text(robot.toml_text, encoding="utf-8")
        (self._folder / URDF_FILE).write_text(robot.urdf_text, encoding="utf-8")
        self._arguments = (
            "--robot",
            self._folder,
            "--listen",
            endpoint,
            "--namespace",
            namespace,
            *IN_NAMESPACE,
            "--real-time",
        )
        self._over = threading.Event()
        self.report = ""
        self.restarts = 0

    @contextmanager
    def running(self) -> Iterator[Self]:
        """Run it while the block runs."""
        self._process = self._started()
        try:
            with background_thread(self._look_after, name="robot", stop=self._over.set):
                yield self
        finally:
            self._process.stop()

    @property
    def pid(self) -> int:
        """Number of its process."""
        return self._process.pid

    def complaint(self) -> str:
        """Return why it has ended, or nothing if it has not."""
        return self._process.complaint()

    def _started(self) -> VerbProcess:
        return VerbProcess(self._folder, "robot", *self._arguments)

    def _look_after(self) -> None:
        while not self._over.wait(_LOOK_S):
            if complaint := self._process.complaint():
                self.report = complaint
                if self._over.wait(_PAUSE_S):
                    return
                self._process = self._started()
                self.restarts += 1
