"""Checkpoints of a learner: file, period, and the one that is there already."""

from dataclasses import dataclass
from pathlib import Path

from pipeline.learner.controller import Controller
from recorders.errors import ConfigError, ControllerError


@dataclass(frozen=True)
class CheckpointConfig:
    """File and period of checkpoints, from which a new process can go on.

    Parameters
    ----------
    path : Path
        File that is replaced, whole or not at all, at every checkpoint; also a controller of its own.
    every_ticks : int
        Ticks between two checkpoints.
    """

    path: Path
    every_ticks: int = 10_000

    def __post_init__(self) -> None:
        """Check the range."""
        if self.every_ticks < 1:
            raise ConfigError(f"checkpoint: expected at least 1 tick between two, found {self.every_ticks}")


def find_checkpoint(path: Path, *, of: str = "a learner") -> Controller | None:
    """Return the checkpoint of a learner in a file; None if there is no file, or an empty one.

    Raises
    ------
    ControllerError
        If there is something else.
    """
    if not path.exists() or (path.is_file() and path.stat().st_size == 0):
        return None
    controller = Controller.load(path)
    if not isinstance(controller.provenance.get("checkpoint"), dict):
        raise no_checkpoint(path, of)
    return controller


def no_checkpoint(path: Path, of: str = "a learner") -> ControllerError:
    """Return the error of a controller that is no checkpoint."""
    return ControllerError(f"{path}: expected a checkpoint of {of}, found a controller without one; move it away")
