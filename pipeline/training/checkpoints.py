"""Checkpoints of a learner: file, period, and the one that is there already."""

from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from pipeline.learner.controller import Controller
from pipeline.training.run import LearningRun
from recorders.errors import ConfigError, ControllerError, MessageError
from recorders.messages.phase import Phase
from recorders.text.wording import value_text


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


class Whole(NamedTuple):
    """A place between ticks: the stream index of the next message, and how many ticks came before it."""

    next: int
    ticks: int


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
        raise _no_checkpoint(path, of)
    return controller


def checkpoint_phase(path: Path) -> Phase | None:
    """Return the phase of the checkpoint in a file; None if there is none.

    Raises
    ------
    ControllerError
        If the file is not a checkpoint.
    """
    found = find_checkpoint(path)
    if found is None:
        return None
    try:
        return Phase(**found.provenance["checkpoint"]["phase"])
    except (KeyError, TypeError, MessageError) as error:
        raise _no_checkpoint(path, "a learner") from error


def resume(run: LearningRun, path: Path, *, run_name: str) -> int:
    """Go on from the checkpoint in a file, if there is one, and return the stream index after it; 0 without one.

    Raises
    ------
    ControllerError
        If it is of another run or learner, or is none.
    """
    controller = find_checkpoint(path, of=f"run {run_name}")
    if controller is None:
        return 0
    saved = controller.provenance["checkpoint"]
    if saved.get("run") != run_name:
        found = str(saved.get("run"))[:64]
        raise ControllerError(f"{path}: expected a checkpoint of run {run_name}, found {found}; move it away")
    run.restore(controller, saved)
    start = saved.get("next")
    if type(start) is not int:
        raise ControllerError(f"{path}: expected the stream index to go on from, found {value_text(start)}")
    return start


def _no_checkpoint(path: Path, of: str) -> ControllerError:
    """Return the error of a controller that is no checkpoint."""
    return ControllerError(f"{path}: expected a checkpoint of {of}, found a controller without one; move it away")
