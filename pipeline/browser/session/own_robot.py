"""The simulated robot as a process of its own, started again whenever it has ended."""

import threading
from pathlib import Path
from types import TracebackType
from typing import Self

from pipeline.deployment.verb_process import IN_NAMESPACE, VerbProcess
from pipeline.robot.config import TOML_FILE, URDF_FILE, RobotConfig

_LOOK_S = 0.2
_PAUSE_S = 1.0  # before it is started again


class OwnRobot:
    """Runs `reenact robot --real-time`, and whatever ends it runs it again, while the block runs.

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

    def __enter__(self) -> Self:
        self._process = self._started()
        self._thread = threading.Thread(target=self._look_after, name="robot", daemon=True)
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._over.set()
        self._thread.join()
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
