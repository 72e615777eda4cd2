"""The errors of the project: one root, one clear line each, and the exit status that goes with it."""

from typing import ClassVar

DISTRIBUTION = "reenact-robot"
"""Name of the program where it is installed from: `reenact` is another's there."""


class ReenactError(Exception):
    """Root of every error raised on purpose; its text is one line for the user.

    The line names what was expected, what was found and, where it helps, what to do.
    """

    exit_status: ClassVar[int] = 2


class LogError(ReenactError):
    """A log is missing, is not MCAP, is cut off, damaged, or lacks what is asked of it."""


class TakenError(LogError):
    """The name of a log is another's: there is one already, or it is being written."""


class MessageError(ReenactError):
    """A message is of the wrong type, does not decode, holds NaN, or comes out of order."""


class OutOfRange(MessageError):
    """Number that cannot be the robot's; `finite` is False if it is NaN or infinite."""

    def __init__(self, line: str, *, finite: bool = True) -> None:
        super().__init__(line)
        self.finite = finite


class JointError(ReenactError):
    """Joint names or counts are not those of the robot."""


class RobotError(ReenactError):
    """A robot is unknown, or its description or configuration is not usable."""


class MotionError(ReenactError):
    """A motion is unknown, malformed, or leaves the robot's reach."""


class ControllerError(ReenactError):
    """A controller file is missing, malformed, or for something else."""


class ConfigError(ReenactError):
    """A configuration value is out of range, or a key is unknown."""


class WireError(ReenactError):
    """A network session could not be opened, a consumer did not answer, or a stream has a gap."""


def file_reason(error: OSError) -> str:
    """Return why a file cannot be read, in words."""
    return "no such file" if isinstance(error, FileNotFoundError) else error.strerror or str(error)


def unreadable(path: object, error: OSError) -> str:
    """Return the line on a file that cannot be read."""
    missing = isinstance(error, FileNotFoundError)
    return f"{path}: {'' if missing else 'cannot be read: '}{file_reason(error)}"


def install_text(extra: str) -> str:
    """Return how an extra is installed, from wherever the program is."""
    return f"install {DISTRIBUTION} with its extra {extra}, as `pip install '.[{extra}]'` does in its source folder"


class MissingExtra(ReenactError):
    """A package that is installed with one of the extras is needed, and is not there.

    Parameters
    ----------
    package : str
        The package, as it is imported.
    extra : str
        The extra that installs it.
    """

    def __init__(self, package: str, extra: str) -> None:
        super().__init__(f"this needs the package {package}, which is not installed; {install_text(extra)}")
        self.extra = extra


class LearningError(ReenactError):
    """A training came to its end, and nothing was learned."""


class UnreachedError(WireError):
    """Nothing listens where a session is to connect."""


class CheckFailed(ReenactError):
    """A check was run and does not hold."""

    exit_status: ClassVar[int] = 1
