"""Lessons: ways in which a controller is learned, each in processes of its own, with the error on the way."""

import json
import signal
import subprocess
import threading
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from pipeline.browser.session.controllers import Place
from pipeline.browser.session.drive import Drive, Mode
from pipeline.browser.teaching import log_learning
from pipeline.browser.teaching.curve import Curve
from pipeline.deployment.verb_process import VerbProcess
from recorders.cdr.codec import decode_as
from recorders.errors import LearningError, MessageError
from recorders.messages.message_types import Float64MultiArray
from recorders.messages.topics import LEARNER_ERROR
from recorders.wire.session import Sample

EXPLORING_RULE = "forward-inverse"
PASSES, SECONDS = "passes", "s"

_PUPIL = "pupil"  # name of the learner among the nodes
_WAIT_S = 60
_CM_PER_M = 100.0
_MAX_PAYLOAD = 1 << 16  # anybody may publish [bytes]


class _Processes:
    """Processes of a lesson in a folder, all of them ended with the block."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._lock = threading.Lock()
        self._running: list[VerbProcess] = []
        self._cancelled = False

    def start(self, verb: str, *arguments: object, name: str, module: str = "pipeline") -> VerbProcess:
        """Start one, with a pipe if it is another module; raises LearningError if the lesson was cancelled."""
        stdout = subprocess.DEVNULL if module == "pipeline" else subprocess.PIPE
        with self._lock:
            if self._cancelled:
                raise LearningError("cancelled")
            process = VerbProcess(self._folder, verb, *arguments, name=name, module=module, stdout=stdout)
            self._running.append(process)
        return process

    def check(self, process: VerbProcess) -> None:
        """Wait for the end of one; raises LearningError unless it did what it should."""
        status = process.wait()
        if self._cancelled:
            raise LearningError("cancelled")
        if status:
            raise LearningError(process.complaint())

    def cancel(self) -> None:
        """End all of them, and start no more."""
        with self._lock:
            self._cancelled = True
            for process in self._running:
                process.send(signal.SIGTERM)

    @contextmanager
    def ended(self) -> Iterator[None]:
        """End all of them with the block."""
        try:
            yield
        finally:
            for process in self._running:
                process.stop()


class Lesson(ABC):
    """A way to learn a controller.

    Parameters
    ----------
    title : str
        What is done.
    curve : Curve
        For the error on the way.
    out : Path
        The controller to write; files of the processes are beside it.

    Attributes
    ----------
    can_finish : bool
        Whether it can end before its end, with what was learned by then.
    """

    can_finish = False

    def __init__(self, title: str, curve: Curve, out: Path) -> None:
        self.title, self.curve, self._out = title, curve, out
        self._processes = _Processes(out.parent)
        self._driving: VerbProcess | None = None  # the process whose end is the end of the lesson
        self._finishing = False

    @property
    def share(self) -> float | None:
        """How much of it is done, 0 to 1; None where nobody knows."""
        return None

    def learn(self) -> Path:
        """Learn to the end, and return the controller's file; raises LearningError."""
        with self._processes.ended():
            self._learn()
        return self._out

    @abstractmethod
    def _learn(self) -> None:
        """Learn to the end, and write the controller."""

    def finish(self) -> None:
        """End now, with what was learned so far; where that cannot be, go on."""
        self._finishing = True
        if self._driving is not None:
            self._driving.send(signal.SIGINT)

    def cancel(self) -> None:
        """End now, with nothing."""
        self._processes.cancel()


class LogLesson(Lesson):
    """Learning from logs, as `reenact train` does.

    Parameters
    ----------
    rule : str
        Name of the learning rule.
    logs : sequence of Path
        What is learned from.
    out : Path
        The controller to write.
    hands : int
        How many hands the robot has.
    """

    def __init__(self, rule: str, logs: Sequence[Path], out: Path, *, hands: int) -> None:
        what = logs[0].stem if len(logs) == 1 else f"{len(logs)} recordings"
        super().__init__(f"learning {rule} from {what:.60}", Curve(hands, PASSES), out)
        self._arguments = (rule, out, *logs)
        self._share: float | None = None

    @property
    def share(self) -> float | None:
        """How many of the passes are through, 0 to 1."""
        return self._share

    def _learn(self) -> None:
        module = log_learning.__name__
        process = self._processes.start("", *self._arguments, name=self._out.stem, module=module)
        for line in process.output or ():
            at, passes, *hands_cm = json.loads(line)
            self.curve.add(at, hands_cm)
            self._share = min(1.0, at / passes)
        self._processes.check(process)


class _LiveCurve(Curve):
    """Curve of a learner that publishes its errors, in the robot's time."""

    def __init__(self, drive: Drive, *, per_round: bool) -> None:
        loop = drive.snapshot().loop if per_round else None
        super().__init__(len(drive.robot.hands), SECONDS if loop is None else PASSES)
        self._drive, self._unit_s = drive, 1.0 if loop is None else loop.duration_s
        self._begun_ns: int | None = None

    @contextmanager
    def following(self, place: Place) -> Iterator[None]:
        """Take the errors that are published while the block runs."""
        with place.keys.subscribing(place.session, LEARNER_ERROR, Float64MultiArray.TYPE, self._take):
            yield

    def _take(self, sample: Sample) -> None:
        """Take errors: on a thread of Zenoh's, of anybody."""
        if len(sample.payload) > _MAX_PAYLOAD:
            return
        try:
            errors_m = decode_as(Float64MultiArray, sample.payload.to_bytes()).data
        except MessageError:
            return
        now_ns = self._drive.snapshot().time_ns
        if self._begun_ns is None:
            self._begun_ns = now_ns
        self.add((now_ns - self._begun_ns) * 1e-9 / self._unit_s, (errors_m * _CM_PER_M).tolist())


class LiveLesson(Lesson):
    """Learning from the targets and joints of now, as `reenact learn --live` does, until it is finished.

    Parameters
    ----------
    rule : str
        Name of the learning rule.
    out : Path
        The controller to write.
    place : Place
        Where the robot is.
    drive : Drive
        Whose ticks are learned from.
    """

    can_finish = True

    def __init__(self, rule: str, out: Path, place: Place, drive: Drive) -> None:
        self._live = _LiveCurve(drive, per_round=drive.snapshot().mode is Mode.MOTION)
        super().__init__(f"learning {rule} from what the robot does", self._live, out)
        self._rule, self._place = rule, place

    def _learn(self) -> None:
        with self._live.following(self._place):
            self._driving = _pupil(self._processes, self._rule, self._out, self._place)
            self._processes.check(self._driving)


class ExploringLesson(Lesson):
    """A learner that leads the robot by itself, as `reenact explore --no-teacher` does, and learns from that.

    Parameters
    ----------
    duration_s : float
        For how long [s].
    out : Path
        The controller to write.
    place : Place
        Where the robot is.
    drive : Drive
        Drive of the robot, which asks nothing of it meanwhile.
    """

    can_finish = True

    def __init__(self, duration_s: float, out: Path, place: Place, drive: Drive) -> None:
        self._live = _LiveCurve(drive, per_round=False)
        super().__init__(f"exploring by itself for {duration_s:g} s", self._live, out)
        self._duration_s, self._place, self._drive = duration_s, place, drive

    @property
    def share(self) -> float | None:
        """How much of the time is over."""
        at_s = self.curve.last_at
        return None if at_s is None else min(1.0, at_s / self._duration_s)

    def learn(self) -> Path:
        """Explore to the end, and return the controller's file; raises LearningError."""
        self._drive.lend(lent=True)
        try:
            return super().learn()
        finally:
            self._drive.lend(lent=False)

    def _learn(self) -> None:
        with self._live.following(self._place):
            self._explore()

    def _explore(self) -> None:
        processes, place = self._processes, self._place
        learner = _pupil(processes, EXPLORING_RULE, self._out, place)
        way = ("--no-teacher", "--duration", self._duration_s, "--await", _PUPIL, "--wait", _WAIT_S)
        name = f"{self._out.stem}_explorer"
        explorer = self._driving = processes.start("explore", *way, *place.arguments, name=name)
        status = explorer.wait()
        if learner.status:  # then that is why
            processes.check(learner)
        if not self._finishing:
            processes.check(explorer)
        elif status:
            learner.send(signal.SIGINT)
        processes.check(learner)


def _pupil(processes: _Processes, rule: str, out: Path, place: Place) -> VerbProcess:
    """Start a learner that learns from the session, and from a stream that awaits it."""
    arguments = ("--live", "--rule", rule, "--out", out, "--name", _PUPIL, *place.arguments)
    return processes.start("learn", *arguments, name=out.stem)
