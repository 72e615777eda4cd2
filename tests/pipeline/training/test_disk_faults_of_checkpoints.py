"""Every operation fails, in every way, while checkpoints are kept: learning goes on from the last to the same state."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from disk_faults import DiskTask, Promised, in_every_way, sweep
from episodes import write_episode

from pipeline.learner.rules.reservoir.config import LearnerConfig
from pipeline.training.checkpoints import CheckpointConfig, find_checkpoint
from pipeline.training.trainer import Trainer, train_on
from recorders.messages.record import RecordedMessage
from replay.sources.schedule import Schedule
from replay.sources.scheduled import Replay

CONFIG = LearnerConfig(reservoir=10, seed=4)
NAME, EVERY = "checkpoint.npz", 25


class Learning(DiskTask):
    """A run that is killed, and gone on with."""

    def __init__(self, replay: Replay) -> None:
        self._replay = replay
        self._expected = train_on(replay, Trainer(CONFIG)).result()

    def prepare(self, folder: Path) -> None:
        """There is nothing."""

    def run(self, folder: Path, promised: Promised) -> None:
        trainer = self._trainer(folder)
        assert trainer.hello(self._replay.offer()) == 0
        assert trainer.consume(self._noting(folder / NAME, promised)) == self._expected
        promised.done = True

    def check(self, folder: Path, promised: Promised, outcome: str) -> None:
        assert self._next(folder / NAME) >= promised.synced

    def run_again(self, folder: Path) -> None:
        trainer = self._trainer(folder)
        start = trainer.hello(self._replay.offer())
        assert trainer.consume(self._replay.stream(start)) == self._expected

    def _trainer(self, folder: Path) -> Trainer:
        return Trainer(CONFIG, checkpoint=CheckpointConfig(folder / NAME, EVERY))

    def _noting(self, path: Path, promised: Promised) -> Iterator[RecordedMessage]:
        for message in self._replay.stream():
            yield message
            promised.handed = promised.synced = self._next(path)

    @staticmethod
    def _next(path: Path) -> int:
        """Return the stream index from which a learner goes on."""
        found = find_checkpoint(path)
        return 0 if found is None else found.provenance["checkpoint"]["next"]


@pytest.fixture(scope="module")
def replay(tmp_path_factory: pytest.TempPathFactory) -> Replay:
    log = write_episode(tmp_path_factory.mktemp("checkpoints") / "log.mcap", samples=6)
    return Replay([log], Schedule(epochs=1))


@in_every_way(5)
def test_learning_goes_on_to_the_same_state(replay: Replay, tmp_path: Path, step: int) -> None:
    sweep(Learning(replay), tmp_path, step)
