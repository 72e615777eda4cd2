"""A verb of ours in a process of its own, and why it has ended, if it has."""

import signal
import subprocess
from pathlib import Path
from types import TracebackType
from typing import IO, Self

from pipeline.deployment.child import PATIENCE_S, command

IN_NAMESPACE = ("--ros=none",)
"""Arguments by which a verb has its topics in a namespace, whatever the settings of the project are."""

_PREFIX = "reenact: "


class VerbProcess:
    """A process that runs `reenact VERB`, or another module of ours; a `with` block ends it.

    Signals of the terminal do not reach it: whoever started it ends it, and where that was killed, it ends by itself.

    Parameters
    ----------
    folder : Path
        Where its standard error goes, into a file of the name.
    verb : str
        The verb.
    arguments : object
        Arguments of the verb.
    name : str
        Name of the process among those of the folder; the verb's if left out.
    module : str
        Module that is run; the arguments alone are its own where it is not the program.
    stdout : int or None
        As `subprocess.Popen` takes it; nothing is read of it by default.
    """

    def __init__(
        self,
        folder: Path,
        verb: str,
        *arguments: object,
        name: str = "",
        module: str = "pipeline",
        stdout: int = subprocess.DEVNULL,
    ) -> None:
        self.name = name or verb
        self._stderr = folder / f"{self.name}.txt"  # a file, not a pipe, which would fill up
        given = [verb, *map(str, arguments)] if module == "pipeline" else list(map(str, arguments))
        with self._stderr.open("wb") as errors:
            self._process = subprocess.Popen(  # noqa: S603  # our own program, no shell
                command(module, *given),
                stdin=subprocess.PIPE,
                stdout=stdout,
                stderr=errors,
                start_new_session=True,
            )

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.stop(signal.SIGTERM)

    @property
    def pid(self) -> int:
        """Number of the process."""
        return self._process.pid

    @property
    def output(self) -> IO[bytes] | None:
        """Its standard output, if that is a pipe."""
        return self._process.stdout

    @property
    def status(self) -> int | None:
        """Exit status, None while it runs."""
        status = self._process.poll()
        if status is not None:
            self._let_go()
        return status

    def wait(self) -> int:
        """Wait until it has ended, and return its exit status."""
        status = self._process.wait()
        self._let_go()
        return status

    def send(self, number: signal.Signals) -> None:
        """Send it a signal, if it runs still."""
        if self.status is None:
            self._process.send_signal(number)

    def stop(self, number: signal.Signals = signal.SIGTERM) -> int:
        """End it by a signal, and if that does not help by force, and return its exit status."""
        self.send(number)
        try:
            return self._process.wait(PATIENCE_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            return self._process.wait()
        finally:
            self._let_go()
            if self._process.stdout is not None:
                self._process.stdout.close()

    def complaint(self) -> str:
        """Return why the process has ended, or nothing if it has not."""
        status = self.status
        if status is None:
            return ""
        lines = self._stderr.read_text(encoding="utf-8", errors="replace").splitlines()
        last = lines[-1] if lines else ""
        return last.removeprefix(_PREFIX) if last.startswith(_PREFIX) else f"`{self.name}` ended with status {status}"

    def _let_go(self) -> None:
        """Close the pipe that this process holds open for as long as the other runs."""
        if self._process.stdin is not None:
            self._process.stdin.close()
