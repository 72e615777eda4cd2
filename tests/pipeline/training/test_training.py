"""Training is one function of the stream: nothing about how the stream arrives enters the learner's state."""

import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from episodes import write_episode, write_plain_episode

from pipeline.learner.controller import Controller
from pipeline.learner.rules.reservoir.config import LearnerConfig
from pipeline.robot.config import load_robot
from pipeline.training import run as learning_run
from pipeline.training.run import CycleReport
from pipeline.training.trainer import Trainer, train, train_on
from recorders.cdr.codec import encode
from recorders.errors import ConfigError, JointError, LogError, MessageError
from recorders.messages.message_types import JointState, Message
from recorders.messages.phase import Phase
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import LEARNER_TOPICS, LEFT_TARGET, SAMPLE_JOINTS, SESSION_PHASE
from recorders.reading.reader import LogReader
from recorders.writing.writer import LogWriter
from replay.sources.schedule import Schedule
from replay.sources.scheduled import Replay

SCHEDULE = Schedule(epochs=3)
CONFIG = LearnerConfig(reservoir=60, seed=4)


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_episode(tmp_path_factory.mktemp("training") / "log.mcap", samples=20)


@pytest.fixture(scope="module")
def replayed(log: Path) -> Replay:
    return Replay([log], SCHEDULE)


def feed(replay: Replay, messages: Iterator[RecordedMessage], config: LearnerConfig = CONFIG) -> Trainer:
    trainer = Trainer(config)
    trainer.hello(replay.offer())
    trainer.consume(messages)
    return trainer


def test_the_same_stream_gives_the_same_state(log: Path, replayed: Replay) -> None:
    first = train([log], schedule=SCHEDULE, config=CONFIG)
    second = feed(replayed, replayed.stream())
    assert first.result() == second.result()
    assert first.controller().digest == first.result()["digest"]
    assert first.result()["steps"] == 3 * 7 * 20
    assert first.result()["ticks"] == 3 * 7 * 21


@pytest.mark.parametrize("piece", [1, 7, 1_000])
def test_the_size_of_the_pieces_does_not_enter(replayed: Replay, piece: int, monkeypatch: pytest.MonkeyPatch) -> None:
    expected = feed(replayed, replayed.stream()).result()
    monkeypatch.setattr(learning_run, "PIECE", piece)
    found = feed(replayed, replayed.stream()).result()
    assert (found["digest"], found["stream_digest"]) == (expected["digest"], expected["stream_digest"])


def test_arrival_order_within_a_tick_does_not_enter(replayed: Replay) -> None:
    def shuffled() -> Iterator[RecordedMessage]:
        generator, tick = np.random.default_rng(2), list[RecordedMessage]()
        for message in replayed.stream():
            if message.topic == SESSION_PHASE:
                yield message
                continue
            tick.append(message)
            if len(tick) == 3:
                yield from (tick[place] for place in generator.permutation(3))
                tick.clear()

    assert list(shuffled()) != list(replayed.stream())
    assert feed(replayed, shuffled()).result() == feed(replayed, replayed.stream()).result()


def test_the_seed_enters(replayed: Replay) -> None:
    digests = {feed(replayed, replayed.stream(), replace(CONFIG, seed=seed)).result()["digest"] for seed in range(3)}
    assert len(digests) == 3


def test_a_nanometre_enters_both_digests(replayed: Replay) -> None:
    def changed() -> Iterator[RecordedMessage]:
        for place, message in enumerate(replayed.stream()):
            if place == 95:  # a target of the first cycle that learns
                assert message.topic == LEFT_TARGET
                data = bytearray(message.data)
                data[-8 * 6 + 3] ^= 1  # bit 24 of y: a pose ends with seven numbers
                message = message._replace(data=bytes(data))
            yield message

    expected, found = feed(replayed, replayed.stream()).result(), feed(replayed, changed()).result()
    assert found["stream_digest"] != expected["stream_digest"]
    assert found["digest"] != expected["digest"]


def test_cycles_are_reported_and_only_learning_changes_weights(log: Path) -> None:
    reports: list[CycleReport] = []
    trainer = train([log], schedule=SCHEDULE, config=CONFIG, on_cycle=reports.append)
    assert [(report.epoch, report.cycle) for report in reports] == [(e, c) for e in range(3) for c in range(7)]
    assert [report.error_cm is not None for report in reports] == [report.phase == "evaluate" for report in reports]
    assert trainer.errors_cm == [report.error_cm for report in reports if report.error_cm is not None]
    still = train([log], schedule=Schedule(epochs=1, phases=(("washout", 2), ("evaluate", 1))), config=CONFIG)
    fresh = Trainer(CONFIG)
    fresh.hello(Replay([log], Schedule(epochs=1)).offer())
    for name, values in fresh.controller().state.items():
        if name in ("a", "b") or name.endswith("_weights"):
            assert np.array_equal(still.controller().state[name], values)
            assert name in UNTAUGHT or not np.array_equal(trainer.controller().state[name], values)


UNTAUGHT = {
    "input_reservoir_weights",
    "reservoir_reservoir_weights",
    "output_reservoir_weights",
    "output_output_weights",
}


def test_the_digest_of_a_small_training_is_known(tmp_path: Path) -> None:
    """One bit anywhere between the log and the state changes these; a new value needs its reason in the changelog."""
    log = write_plain_episode(tmp_path / "plain.mcap")
    result = train([log], schedule=SCHEDULE, config=CONFIG).result()
    assert (result["digest"], result["stream_digest"]) == (STATE_DIGEST, STREAM_DIGEST)


STATE_DIGEST = "2548b04c34c4ffff79dfabd27fef1aa1088ccf527518dfbf93785ce9a2a5a617"
STREAM_DIGEST = "37dd3470ab29e26ccd06fd287edfefe0f4181d6e766833f4e02cbde6e61d3ef4"


def test_every_epoch_begins_with_a_state_of_its_own(log: Path) -> None:
    silent = Schedule(epochs=2, phases=(("washout", 1),))
    states = []

    def note(report: CycleReport) -> None:
        states.append(report.digest)

    train([log], schedule=silent, config=CONFIG, on_cycle=note)
    again = train([log], schedule=Schedule(epochs=1, phases=(("washout", 2),)), config=CONFIG)
    assert len(set(states)) == 2
    assert states[1] != again.result()["digest"]


def test_a_cycle_of_several_logs_is_one_cycle(log: Path, tmp_path: Path) -> None:
    other = write_episode(tmp_path / "other.mcap", samples=7)
    reports: list[CycleReport] = []
    trainer = train([log, other], schedule=SCHEDULE, config=CONFIG, on_cycle=reports.append)
    assert len(reports) == 3 * 7
    assert len(trainer.errors_cm) == 3
    assert trainer.result()["steps"] == 3 * 7 * (20 + 7)


def test_a_trainer_that_is_used_again_begins_anew(replayed: Replay) -> None:
    trainer = Trainer(CONFIG)
    first = train_on(replayed, trainer).result()
    assert train_on(replayed, trainer).result() == first
    assert len(trainer.errors_cm) == SCHEDULE.epochs


def test_a_log_without_a_robot_trains_with_one_that_is_given(log: Path, tmp_path: Path) -> None:
    bare = write_episode(tmp_path / "bare.mcap", samples=20, attachments={})
    with pytest.raises(ConfigError, match="--robot"):
        train([bare], schedule=SCHEDULE, config=CONFIG)
    given = train([bare], schedule=SCHEDULE, config=CONFIG, robot=load_robot("asimo"))
    assert given.result() == train([log], schedule=SCHEDULE, config=CONFIG).result()


def test_a_foreign_log_trains_once_its_topics_are_renamed(log: Path, tmp_path: Path) -> None:
    def foreign(tick: int, topic: str, message: Message) -> Sequence[tuple[str, Message]]:
        return [(f"/lab{topic}", message)]

    path = write_episode(tmp_path / "foreign.mcap", samples=20, change=foreign)
    with pytest.raises(LogError, match=r"--map one of /lab/hand/left/target"):
        train([path], schedule=SCHEDULE, config=CONFIG)
    names = {f"/lab{topic.name}": topic.name for topic in LEARNER_TOPICS}
    renamed = train([path], schedule=SCHEDULE, config=CONFIG, renames=names)
    assert renamed.result() == train([log], schedule=SCHEDULE, config=CONFIG).result()


def test_arrival_order_in_the_log_does_not_enter(log: Path, tmp_path: Path) -> None:
    with LogWriter(tmp_path / "turned.mcap", manifest={}, attachments=attachments_of(log)) as writer:
        records = list(LogReader(log))
        for first in range(0, len(records), 3):
            for record in reversed(records[first : first + 3]):
                writer.copy(record)
    turned = train([tmp_path / "turned.mcap"], schedule=SCHEDULE, config=CONFIG)
    assert turned.result() == train([log], schedule=SCHEDULE, config=CONFIG).result()


def attachments_of(log: Path) -> dict[str, bytes]:
    reader = LogReader(log)
    return {name: reader.attachment(name) for name in reader.attachments}


def test_learning_lowers_the_error(log: Path) -> None:
    errors_cm = train([log], schedule=Schedule(epochs=150), config=CONFIG).errors_cm
    assert errors_cm[-1] < errors_cm[0] / 3


def test_the_controller_tells_where_it_comes_from(log: Path, tmp_path: Path) -> None:
    trainer = train([log], schedule=SCHEDULE, config=CONFIG)
    trainer.controller().save(tmp_path / "controller.npz")
    controller = Controller.load(tmp_path / "controller.npz")
    assert controller.digest == trainer.result()["digest"]
    assert controller.config.epochs == SCHEDULE.epochs
    assert controller.provenance["schedule"] == SCHEDULE.to_dict()
    assert controller.provenance["logs"][0]["name"] == "log.mcap"
    assert controller.provenance["stream_digest"] == trainer.result()["stream_digest"]
    assert controller.pending.shape == (6,)


def test_an_offer_without_a_robot_is_refused(replayed: Replay) -> None:
    with pytest.raises(ConfigError, match="--robot"):
        Trainer(CONFIG).hello(replace(replayed.offer(), robot={}))


def test_messages_before_a_phase_marker_are_refused(replayed: Replay) -> None:
    with pytest.raises(MessageError, match="expected a phase marker before it"):
        feed(replayed, replayed.stream(1))


def test_a_marker_of_another_run_is_refused(replayed: Replay) -> None:
    marker = RecordedMessage(
        SESSION_PHASE, "std_msgs/msg/String", encode(Phase("other", 0, 0, "learn", "").to_message()), 0, 0
    )
    with pytest.raises(MessageError, match=r"expected run .* found other"):
        feed(replayed, iter([marker]))


def test_a_lost_message_is_named(replayed: Replay) -> None:
    messages = [message for place, message in enumerate(replayed.stream()) if place != 8]
    with pytest.raises(MessageError, match=r"/hand/right/target"):
        feed(replayed, iter(messages))


def test_another_robots_joints_are_refused(replayed: Replay) -> None:
    def foreign() -> Iterator[RecordedMessage]:
        for message in replayed.stream():
            if message.topic == SAMPLE_JOINTS:
                message = message._replace(data=encode(JointState(0, ("wheel",), np.zeros(1))))
            yield message

    with pytest.raises(JointError, match="wheel"):
        feed(replayed, foreign())


def test_training_from_a_file_loads_neither_drake_nor_zenoh_nor_rerun(log: Path, tmp_path: Path) -> None:
    program = (
        "import sys; from pipeline.cli.app import main\n"
        "try: main(sys.argv[1:])\n"
        "except SystemExit as end: assert end.code == 0, end.code\n"
        "print(sorted({'pydrake', 'zenoh', 'rerun', 'matplotlib'} & set(sys.modules)))"
    )
    arguments = ["train", str(log), "--epochs", "1", "--out", str(tmp_path / "c.npz"), "--json"]
    run = subprocess.run([sys.executable, "-c", program, *arguments], capture_output=True, text=True, check=True)
    assert run.stdout.splitlines()[-1] == "[]"
