"""Every operation fails, in every way, while a controller is saved: the old one is there or the new one, whole."""

from pathlib import Path

import numpy as np
import pytest
from disk_faults import DiskTask, Promised, in_every_way, sweep

from pipeline.learner.controller import Controller, check_writable
from pipeline.learner.rules.reservoir.config import LearnerConfig
from pipeline.learner.rules.reservoir.learner import Learner

NAME = "controller.npz"


def controller(seed: int) -> Controller:
    config = LearnerConfig(reservoir=10, outputs=8, epochs=2, seed=seed)
    learner = Learner(config, input_centre=np.arange(6.0), output_centre=np.arange(8.0))
    return Controller.from_learner(
        learner, joints=("hip", "elbow"), robot_toml="", robot_urdf="", pending=np.arange(6.0), provenance={}
    )


class Saving(DiskTask):
    """A controller, in the place of another or of none."""

    def __init__(self, *, replaces: bool) -> None:
        self.replaces = replaces
        self._old, self._new = controller(0), controller(1)

    def prepare(self, folder: Path) -> None:
        if self.replaces:
            self._old.save(folder / NAME)

    def run(self, folder: Path, promised: Promised) -> None:
        check_writable(folder / NAME)
        self._new.save(folder / NAME)
        promised.done = True

    def check(self, folder: Path, promised: Promised, outcome: str) -> None:
        if not (folder / NAME).exists():
            assert not self.replaces
            assert not promised.done
            return
        found = Controller.load(folder / NAME).digest
        assert found == self._new.digest or (self.replaces and not promised.done and found == self._old.digest)

    def run_again(self, folder: Path) -> None:
        check_writable(folder / NAME)
        self._new.save(folder / NAME)
        assert Controller.load(folder / NAME).digest == self._new.digest


@pytest.mark.parametrize("replaces", [False, True])
@in_every_way(3)
def test_a_controller_is_there_whole(tmp_path: Path, step: int, replaces: bool) -> None:
    sweep(Saving(replaces=replaces), tmp_path, step)
