"""The online learner as a consumer of messages: live, replayed over Zenoh or read from a file, by the same code."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

from pipeline.learner.controller import Controller
from pipeline.learner.registry import find_rule
from pipeline.learner.rule import Settings
from pipeline.robot.config import RobotConfig
from pipeline.robot.recorded import offered_robot, recorded_hands
from pipeline.samples.pairing import fitting_pairing
from pipeline.samples.pairs import Presentation
from pipeline.training.checkpoints import CheckpointConfig, Whole, checkpoint_phase, resume
from pipeline.training.pairing_choice import pairing_for, pairing_of
from pipeline.training.run import CycleReport, LearningRun, Steps
from recorders.errors import ConfigError, JointError, LearningError, MessageError
from recorders.messages.phase import LEARN, Phase
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import SESSION_PHASE
from recorders.protocol.stream import Offer
from recorders.text.wording import names_text
from replay.sources.schedule import Schedule
from replay.sources.scheduled import EpisodeLog, Replay, naming
from replay.transports.transport import InProcess, Source

_NO_RENAMES: Mapping[str, str] = {}
_PROGRESS_TICKS = 64  # between two words of progress


class Trainer:
    """Feeds a learner, message by message, and scores its predictions before each update.

    Parameters
    ----------
    config : Settings
        The learner. Its number of epochs, over which the rates fall, is the stream's; its outputs fit the robot.
    robot : RobotConfig, optional
        The robot; taken from the stream's offer if left out.
    pairs : str, optional
        Name of the pairing rule; that of the learning rule if left out. Of a stream that lacks its topics, the rule in
        its place is followed, if there is one.
    checkpoint : CheckpointConfig, optional
        Where to keep checkpoints; one that is there already, of the same run, is gone on from.
    on_cycle : callable
        Called with every finished cycle.
    on_progress : callable
        Called now and then with the ticks so far, and the share of the stream that is through, if its length is known.
    """

    def __init__(
        self,
        config: Settings,
        *,
        robot: RobotConfig | None = None,
        pairs: str | None = None,
        checkpoint: CheckpointConfig | None = None,
        on_cycle: Callable[[CycleReport], None] = lambda report: None,
        on_progress: Callable[[int, float | None], None] = lambda ticks, share: None,
    ) -> None:
        self.pairing = self._asked = pairing_of(config, pairs)
        self._config = config
        self._robot = robot
        self._checkpoint = checkpoint
        self._on_cycle = on_cycle
        self._on_progress = on_progress
        self._on_steps: Callable[[Steps], None] | None = None
        self._reported_ticks = self._saved_ticks = 0
        self._run: LearningRun | None = None
        self._offer: Offer | None = None
        self._next = 0  # stream index of the next message
        self._whole = Whole(0, 0)
        self._busy = False  # whether a message is half-way in: a signal may interrupt anything
        find_rule(config.rule).load()

    def hello(self, offer: Offer) -> int:
        """Make a learner for the run on offer, and return the stream index that it wants next.

        Raises
        ------
        ConfigError, RobotError
            If the offer's schedule or robot is not usable, or its topics are not those of the pairs.
        ControllerError
            If there is a checkpoint of another run, or it cannot be used.
        """
        schedule = Schedule.from_dict(offer.schedule)
        robot = self._robot or offered_robot(offer, has_option=True)
        self._check_pairing(schedule, robot)
        config = self._config.fitted(epochs=schedule.epochs)
        run = LearningRun(config, robot, offer.run, pairing=self.pairing, on_steps=self._on_steps)
        self._next = 0 if self._checkpoint is None else resume(run, self._checkpoint.path, run_name=offer.run)
        self._saved_ticks = run.counts.ticks
        self._whole = Whole(self._next, run.counts.ticks)
        self._run, self._offer = run, offer
        return self._next

    def report_to(self, listener: Callable[[CycleReport], None]) -> None:
        """Call one more listener with every finished cycle."""
        earlier = self._on_cycle

        def both(report: CycleReport) -> None:
            earlier(report)
            listener(report)

        self._on_cycle = both

    def show_steps_to(self, listener: Callable[[Steps], None]) -> None:
        """Show a listener the steps of the run that is accepted next, as they are taken."""
        self._on_steps = listener

    @property
    def checkpoint_phase(self) -> Phase | None:
        """The phase of the checkpoint that is there already; None without one.

        Raises
        ------
        ControllerError
            If the file is not a checkpoint.
        """
        return None if self._checkpoint is None else checkpoint_phase(self._checkpoint.path)

    def settle(self, *, keep: bool) -> None:
        """Take the steps that are complete, as nothing more comes at present, and with `keep` keep a checkpoint."""
        if (run := self._run) is None:
            return
        run.settle()
        self._report_progress(run)
        if keep and run.counts.ticks > self._saved_ticks:
            self.save_checkpoint()

    def so_far(self) -> CycleReport | None:
        """Return the report of the cycle under way, if one is."""
        return None if self._run is None else self._run.so_far()

    @property
    def ticks(self) -> int:
        """Ticks of the run so far; 0 before there is one."""
        return 0 if self._run is None else self._run.counts.ticks

    @property
    def epochs(self) -> int:
        """Epochs of the run that was accepted."""
        return self._running().learner.config.epochs

    @property
    def cycles(self) -> int:
        """Cycles of all epochs of the run that was accepted."""
        schedule = Schedule.from_dict(self._offer.schedule if self._offer else {})
        return schedule.epochs * schedule.cycles

    @property
    def errors_cm(self) -> list[float]:
        """Eq. (10) of every evaluated cycle so far."""
        return list(self._running().counts.errors_cm)

    def consume(self, messages: Iterator[RecordedMessage]) -> dict[str, Any]:
        """Learn from the whole stream and return both digests, counts and the last error.

        Raises
        ------
        MessageError, JointError
            If a message is not what it should be; it is named, and so is its log.
        LearningError
            If no step was taken.
        """
        self.take(messages)
        self._check_steps()
        return self.result()

    def take(self, messages: Iterator[RecordedMessage]) -> None:
        """Learn from messages, of which more may come, and end the presentation under way.

        Raises
        ------
        MessageError, JointError
            If a message is not what it should be; it is named, and so is its log.
        """
        run = self._running()
        with self._naming_the_log(run):
            for message in messages:
                self._busy = True
                self._take(run, message)
                self._busy = False
                self._keep(run)
            self._busy = True
            self._report(run.end())
            self._busy = False

    def check_learned(self, why: str = "") -> None:
        """Check that the whole stream taught something; `why` it may not have done so ends the line.

        Raises
        ------
        LearningError
            If no step was taken in a cycle that is for learning.
        """
        self._check_steps(why)
        counts = self._running().counts
        if counts.learned_steps == 0:
            raise LearningError(
                f"nothing was learned: expected a phase '{LEARN}', found {counts.steps} steps, all in other phases{why}"
            )

    def check_moved(self) -> list[str]:
        """Return lines on what teaches little, as `JointExtent.notes` does; raises LearningError if nothing moved."""
        run = self._running()
        samples = run.counts.steps // self.cycles
        run.extent.check_moved(samples)
        return run.extent.notes(samples)

    def _check_steps(self, why: str = "") -> None:
        if (counts := self._running().counts).steps == 0:
            raise LearningError(
                "nothing was learned: expected ticks that follow upon one another, "
                f"found {counts.ticks} ticks, no two that make a step{why}"
            )

    def learn(self, replay: Replay) -> dict[str, Any]:
        """Learn from logs that are in memory: what `consume` makes of the stream, but each log is joined only once.

        Raises
        ------
        MessageError, JointError
            If a message is not what it should be; it is named, and so is its log.
        LearningError
            If no step was taken.
        """
        self.hello(replay.offer())
        run = self._running()
        presentations: dict[EpisodeLog, Presentation] = {}
        for episode in replay.episodes:
            with naming(episode.path):
                presentations[episode] = Presentation.of(episode, run.robot, self.pairing)
        for marker, episode in replay.presentations():
            self._report(run.present(marker, presentations[episode]))
            self._next += 1 + episode.count
            self._report_progress(run)
        self._report(run.end())
        self._check_steps()
        return self.result()

    @property
    def keeps(self) -> bool:
        """Whether it keeps checkpoints."""
        return self._checkpoint is not None

    def result(self) -> dict[str, Any]:
        """Return digests, counts and the last error of the run so far, as JSON has it."""
        run = self._running()
        return {
            "digest": run.digest(),
            "stream_digest": run.stream_digest,
            "steps": run.counts.steps,
            "ticks": run.counts.ticks,
            "train_cm": run.counts.errors_cm[-1] if run.counts.errors_cm else None,
        }

    def controller(self) -> Controller:
        """Return what was learned, with where it comes from."""
        return self._running().controller(self._provenance())

    def save_checkpoint(self) -> None:
        """Save the learner as of its last complete tick, if it had one, has a checkpoint, and can be resumed there.

        It cannot while messages of several ticks are interleaved, nor after it was interrupted in the middle of one.

        Raises
        ------
        ControllerError
            If the file cannot be written.
        """
        if (run := self._run) is None or self._checkpoint is None or self._busy:
            return
        if run.counts.ticks == self._whole.ticks > 0:
            checkpoint = run.controller(
                {**self._provenance(), "checkpoint": {"next": self._whole.next, **run.snapshot()}}
            )
            checkpoint.save(self._checkpoint.path)
            self._saved_ticks = run.counts.ticks

    def _check_pairing(self, schedule: Schedule, robot: RobotConfig) -> None:
        """Follow the pairing rule asked for, or the one in its place."""
        hands, topics = robot.hand_names, schedule.topics
        self.pairing = fitting_pairing(self._asked, hands, topics, where="the stream")
        if missing := self.pairing.missing(hands, topics):
            raise ConfigError(
                f"pairs {self.pairing.name}: expected a stream with {names_text(missing)}, found one of "
                f"{names_text(topics)}; give sender and learner the same --pairs, and the same robot"
            )

    def _provenance(self) -> dict[str, Any]:
        run, offer = self._running(), self._offer
        return {
            "run": offer.run if offer else "",
            "logs": offer.logs if offer else [],
            "schedule": offer.schedule if offer else {},
            "stream_digest": run.stream_digest,
            "errors_cm": list(run.counts.errors_cm),
        }

    def _keep(self, run: LearningRun) -> None:
        if run.counts.ticks - self._reported_ticks >= _PROGRESS_TICKS:
            self._report_progress(run)
        due = self._checkpoint is not None and run.counts.ticks - self._saved_ticks >= self._checkpoint.every_ticks
        if due and run.between_ticks:
            self.save_checkpoint()

    def _take(self, run: LearningRun, message: RecordedMessage) -> None:
        if message.topic == SESSION_PHASE:
            self._report(run.begin_presentation(message))
        else:
            run.feed(message)
        self._next += 1
        if run.between_ticks:
            self._whole = Whole(self._next, run.counts.ticks)

    def _report_progress(self, run: LearningRun) -> None:
        self._reported_ticks = run.counts.ticks
        messages = self._offer.messages if self._offer else None
        self._on_progress(run.counts.ticks, self._next / messages if messages else None)

    def _report(self, report: CycleReport | None) -> None:
        if report is not None:
            self._on_cycle(report)

    @contextmanager
    def _naming_the_log(self, run: LearningRun) -> Iterator[None]:
        """Put the name of the log that is presented before what is wrong with a message."""
        try:
            yield
        except (MessageError, JointError) as error:
            self._busy = False  # a message that is refused leaves the run as it was
            logs = self._offer.logs if self._offer else []
            names = [log.get("name") for log in logs if run.phase and log.get("ticks_sha256") == run.phase.log]
            raise type(error)(f"{names[0]}: {error}" if names else str(error)) from error

    def _running(self) -> LearningRun:
        if self._run is None:
            raise ConfigError("expected an offer before the first message, found none")
        return self._run


def train(
    paths: Sequence[str | Path],
    *,
    schedule: Schedule,
    config: Settings,
    robot: RobotConfig | None = None,
    pairs: str | None = None,
    renames: Mapping[str, str] = _NO_RENAMES,
    on_cycle: Callable[[CycleReport], None] = lambda report: None,
) -> Trainer:
    """Train a learner straight from logs: the same messages, in the same order, as a replay sends.

    Parameters
    ----------
    paths : sequence of str or Path
        Logs; a cycle presents them in this order.
    schedule : Schedule
        Epochs and phases.
    config : Settings
        The learner.
    robot : RobotConfig, optional
        The robot, for logs that carry none.
    pairs : str, optional
        Name of the pairing rule, whose topics are presented; that of the learning rule if left out. Of logs that lack
        its topics, the rule in its place is followed, if there is one.
    renames : mapping of str to str
        Our topic names for those that the logs use.
    on_cycle : callable
        Called with every finished cycle.

    Raises
    ------
    ReenactError
        If a log, its robot or a message is not what it should be.
    """
    logs = [Path(path) for path in paths]
    pairing = pairing_for(pairing_of(config, pairs), logs, robot=robot, renames=renames)
    trainer = Trainer(config, robot=robot, pairs=pairing.name, on_cycle=on_cycle)
    hands = recorded_hands(logs[0], robot=robot, renames=renames) if logs else ()
    topics = pairing.topics(hands) if hands else schedule.topics
    return train_on(Replay(logs, replace(schedule, topics=topics), renames=renames), trainer)


def train_on(source: Source, trainer: Trainer) -> Trainer:
    """Feed a trainer the whole stream of a source, such as logs or a recorded session, in this process.

    Raises
    ------
    ReenactError
        If a log, its robot or a message is not what it should be.
    """
    if isinstance(source, Replay) and source.retained and not trainer.keeps:
        trainer.learn(source)
    else:
        InProcess({"learner": trainer}).deliver(source.offer(), source.stream)
    return trainer
