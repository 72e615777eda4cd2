"""Teaching: one lesson at a time, after which what was learned leads, and is kept or undone."""

import logging
import threading
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from pipeline.browser.session.controllers import TEACHER
from pipeline.browser.session.drive import Mode
from pipeline.browser.session.play import Play
from pipeline.browser.session.recordings import free_path, visible_name
from pipeline.browser.teaching.curve import Curve
from pipeline.browser.teaching.lessons import ExploringLesson, Lesson, LiveLesson, LogLesson
from recorders.errors import LearningError, ReenactError
from recorders.files.anonymous_file import write_whole
from recorders.files.disk import make_folders
from recorders.text.wording import names_text

logger = logging.getLogger(__name__)

RULES = ("forward-inverse", "reservoir")
"""Rules that are taught on the page."""

LEAST_S, MOST_S = 5, 600
"""How long a learner may lead the robot by itself [s]."""

SELF_TAUGHT = "self-taught"
"""First part of the names of controllers that explored by themselves."""


@dataclass(frozen=True)
class Taught:
    """A controller that was learned, and is neither kept nor undone yet.

    Attributes
    ----------
    name : str
        Its name among the controllers.
    before : str
        Name of the controller that led before.
    path : Path
        Its file.
    """

    name: str
    before: str
    path: Path


class Teaching:
    """Teaches controllers on a thread of its own; commands of the robot never wait for it.

    Parameters
    ----------
    play : Play
        What runs.

    Attributes
    ----------
    curve : Curve or None
        Error in the lesson of now or the last.
    line : str
        What there is to be read of the last lesson.
    failure : str
        Why the last thing that was asked for failed; empty if it did not.
    """

    def __init__(self, play: Play) -> None:
        self._play = play
        self._lock = threading.Lock()
        self._taught: list[Taught] = []
        self._lesson: Lesson | None = None
        self._thread: threading.Thread | None = None
        self._count = 0
        self._closed = False
        self.curve: Curve | None = None
        self.line = self.failure = ""

    @property
    def lesson(self) -> Lesson | None:
        """The lesson under way."""
        return self._lesson

    @property
    def taught(self) -> Taught | None:
        """The last controller that was learned, if it is neither kept nor undone yet."""
        return self._taught[-1] if self._taught else None

    def learn(self, rule: str, logs: tuple[str, ...]) -> None:
        """Begin to learn by a rule from logs of the folder; raises LearningError, LogError."""
        _check_rule(rule)
        paths = [self._play.recordings.path(name) for name in logs]
        if not paths:
            raise LearningError("expected a recording to learn from, found none: record one")
        hands = len(self._play.robot.hands)
        self._begin(rule, lambda out: LogLesson(rule, paths, out, hands=hands))

    def learn_live(self, rule: str) -> None:
        """Begin to learn by a rule from what the robot does; raises LearningError if nothing is asked of it."""
        _check_rule(rule)
        play = self._play
        if play.drive.snapshot().mode is Mode.AT_REST:
            raise LearningError("expected a robot that moves, found one of which nothing is asked: choose a motion")
        self._begin(rule, lambda out: LiveLesson(rule, out, play.recordings.place, play.drive))

    def explore(self, duration_s: float) -> None:
        """Let a learner lead the robot by itself for so long [s]; raises LearningError where it cannot."""
        play = self._play
        if not LEAST_S <= duration_s <= MOST_S:
            raise LearningError(f"expected {LEAST_S} to {MOST_S} s to explore, found {duration_s!r:.60}")
        if play.controllers is None:
            raise LearningError(
                "expected a robot of this page's own, found one that others lead: use `reenact explore`"
            )
        if play.recordings.under_way is not None:
            raise LearningError(f"expected no recording under way, found {play.recordings.under_way.name}: end it")
        self._begin(SELF_TAUGHT, lambda out: ExploringLesson(float(duration_s), out, play.recordings.place, play.drive))

    def finish(self) -> None:
        """End the lesson with what was learned so far."""
        if self._lesson is not None:
            self._lesson.finish()

    def cancel(self) -> None:
        """End the lesson with nothing."""
        if self._lesson is not None:
            self._lesson.cancel()

    def keep(self, name: str) -> Path:
        """Keep the last controller in the folder under a name, with a number behind it if that is taken.

        Raises
        ------
        LearningError
            If there is none that is not kept.
        LogError
            If the name is none.
        OSError
            If it cannot be written.
        """
        taught, folder = self._last(), self._play.recordings.folder
        name = visible_name(name.strip() or taught.name)
        make_folders(folder)
        kept = free_path(folder / f"{name}.npz")
        write_whole(kept, taught.path.read_bytes())
        self._taught.remove(taught)
        self.line, self.failure = f"{taught.name} is kept as {kept}; `reenact serve {kept}` serves it", ""
        return kept

    def undo(self) -> None:
        """Forget the last controller, and have the one lead that did before; raises LearningError if there is none."""
        play, taught = self._play, self._last()
        controllers = play.controllers
        self._taught.remove(taught)
        self.line, self.failure = f"{taught.name} is undone", ""
        if controllers is None:
            return

        def forget() -> None:
            """Have the one before lead, then forget this one."""
            if play.link.controller == taught.name:
                play.lead(taught.before if taught.before in controllers.names else TEACHER)
            controllers.remove(taught.name)
            play.drive.forget_controller(taught.name)

        play.activity.do(f"undoing {taught.name}", forget)

    def close(self) -> None:
        """End the lesson under way, and begin no more."""
        with self._lock:
            self._closed, thread = True, self._thread
        self.cancel()
        if thread is not None:
            thread.join()

    def _last(self) -> Taught:
        if (taught := self.taught) is None:
            raise LearningError("expected a controller that was just learned, found none")
        return taught

    def _begin(self, kind: str, make: Callable[[Path], Lesson]) -> None:
        """Begin a lesson; raises LearningError if one is under way."""
        with self._lock:
            if self._closed or self._lesson is not None:
                raise LearningError(
                    f"{self._lesson.title if self._lesson else 'the page'} is not done yet: wait for it"
                )
            name = self._free_name(kind)
            lesson = self._lesson = make(self._play.recordings.place.folder / f"{name}.npz")
            self.curve, self.line, self.failure = lesson.curve, "", ""
            self._thread = threading.Thread(target=self._learn, args=(lesson, name), name="lesson")
            self._thread.start()

    def _free_name(self, kind: str) -> str:
        names = () if self._play.controllers is None else self._play.controllers.names
        while True:
            self._count += 1
            if (name := f"{kind}-{self._count}") not in names:
                return name

    def _learn(self, lesson: Lesson, name: str) -> None:
        """Have a lesson to its end, and what was learned lead."""
        try:
            path = lesson.learn()
            if not self._closed:
                self._use(name, path, lesson.curve)
        except (ReenactError, OSError) as error:
            self.failure = f"{lesson.title}: {error}"
        except Exception:
            self.failure = f"{lesson.title}: an error of this program; see the terminal"
            logger.exception(f"{lesson.title} failed")
        finally:
            self._lesson = None

    def _use(self, name: str, path: Path, curve: Curve) -> None:
        play = self._play
        self._taught.append(Taught(name, play.link.controller, path))
        off = "" if curve.last_cm is None else f", {curve.last_cm:.2f} cm off at the end"
        if play.controllers is None:
            self.line = f"{name} learned{off}: keep it, and serve it in place of the one that serves"
            return
        self.line = f"{name} learned{off}"
        play.controllers.add(path, name)
        play.choose(name)


def _check_rule(rule: str) -> None:
    """Raise LearningError unless the page teaches a rule: a browser may send any text."""
    if rule not in RULES:
        raise LearningError(f"rule: expected one of {names_text(RULES)}, found {rule!r:.60}")
