"""A checkpoint holds complete ticks only, and going on from it gives the state of a run that never stopped."""

from collections.abc import Iterator
from itertools import islice
from pathlib import Path

import pytest
from episodes import write_episode

from pipeline.learner.controller import Controller
from pipeline.learner.rule import Settings
from pipeline.learner.rules.forward_inverse.config import ForwardInverseConfig
from pipeline.learner.rules.reservoir.config import LearnerConfig
from pipeline.training.checkpoints import CheckpointConfig
from pipeline.training.trainer import Trainer, train_on
from recorders.errors import ConfigError, ControllerError, WireError
from recorders.messages.record import RecordedMessage
from replay.sources.schedule import Schedule
from replay.sources.scheduled import Replay

CONFIG = LearnerConfig(reservoir=60, seed=4)
FORWARD_INVERSE = ForwardInverseConfig(degree=2, forgetting=0.999)


@pytest.fixture(scope="module")
def replay(tmp_path_factory: pytest.TempPathFactory) -> Replay:
    log = write_episode(tmp_path_factory.mktemp("checkpoints") / "log.mcap", samples=10)
    return Replay([log], Schedule(epochs=2))


def cut(replay: Replay, start: int, end: int) -> Iterator[RecordedMessage]:
    yield from islice(replay.stream(start), end - start)
    if end < len(replay):
        raise WireError("killed")


@pytest.mark.parametrize(
    ("every", "stop", "config"),
    [(every, stop, CONFIG) for every in (1, 7, 50) for stop in (1, 2, 50, 100, 232, 233, 300, 463)]
    + [(every, stop, FORWARD_INVERSE) for every, stop in ((1, 100), (7, 233), (50, 463))],
)
def test_it_goes_on_to_the_same_state(replay: Replay, tmp_path: Path, every: int, stop: int, config: Settings) -> None:
    pairs = "commanded"
    whole = train_on(replay, Trainer(config, pairs=pairs))
    checkpoint = CheckpointConfig(tmp_path / "k.npz", every)
    first = Trainer(config, pairs=pairs, checkpoint=checkpoint)
    start = first.hello(replay.offer())
    assert start == 0
    with pytest.raises(WireError, match="killed"):
        first.consume(cut(replay, start, stop))
    second = Trainer(config, pairs=pairs, checkpoint=checkpoint)
    resumed = second.hello(replay.offer())
    assert resumed <= stop
    assert second.consume(replay.stream(resumed)) == whole.result()
    assert second.errors_cm == whole.errors_cm


def test_messages_of_an_unfinished_tick_are_not_in_it(replay: Replay, tmp_path: Path) -> None:
    trainer = Trainer(CONFIG, checkpoint=CheckpointConfig(tmp_path / "k.npz", 1))
    trainer.hello(replay.offer())
    with pytest.raises(WireError):
        trainer.consume(cut(replay, 0, 1 + 3 * 4 + 2))  # a marker, four ticks, two messages of the fifth
    kept = Controller.load(tmp_path / "k.npz").provenance["checkpoint"]
    assert kept["next"] == 1 + 3 * 4
    assert kept["counts"]["ticks"] == 4


def test_a_checkpoint_is_a_controller(replay: Replay, tmp_path: Path) -> None:
    train_on(replay, Trainer(CONFIG, checkpoint=CheckpointConfig(tmp_path / "k.npz", 1)))
    assert Controller.load(tmp_path / "k.npz").learner().predict([[0.3, 0.2, 0.7, 0.3, -0.2, 0.7]]).shape == (1, 21)


def test_another_learner_does_not_go_on_from_it(replay: Replay, tmp_path: Path) -> None:
    checkpoint = CheckpointConfig(tmp_path / "k.npz", 1)
    train_on(replay, Trainer(CONFIG, checkpoint=checkpoint))
    with pytest.raises(ControllerError, match="another learner configuration"):
        Trainer(LearnerConfig(reservoir=60, seed=5), checkpoint=checkpoint).hello(replay.offer())


def test_a_plain_controller_is_no_checkpoint(replay: Replay, tmp_path: Path) -> None:
    train_on(replay, Trainer(CONFIG)).controller().save(tmp_path / "c.npz")
    with pytest.raises(ControllerError, match=r"c\.npz: expected a checkpoint of run"):
        Trainer(CONFIG, checkpoint=CheckpointConfig(tmp_path / "c.npz", 1)).hello(replay.offer())


def test_checkpoints_are_at_least_a_tick_apart(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="at least 1 tick"):
        CheckpointConfig(tmp_path / "k.npz", 0)
