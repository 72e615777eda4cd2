"""The chain of the main job: explore, record, replay over Zenoh, learn, check against the recording, report."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from pipeline.demo import deployables
from pipeline.demo.beside import beside, learn_over_zenoh
from pipeline.demo.deployables import CONTROLLERS, DURATION_S, Deployable, learn_self_taught, learn_taught
from pipeline.demo.trials import Trials, try_motions
from pipeline.evaluation.trials import Trial, robot_of
from pipeline.exploration.explore import explore
from pipeline.learner.controller import Controller
from pipeline.learner.rules.reservoir.config import LearnerConfig
from pipeline.motions.motion import load_motion
from pipeline.motions.names import PATTERNS
from pipeline.published import published_digests
from pipeline.robot.config import RobotConfig, load_robot
from pipeline.terminal import console
from pipeline.training.trainer import Trainer, train
from pipeline.views.figures import MotionTest, draw_report
from pipeline.views.live import LiveView
from pipeline.views.motion import MotionView
from pipeline.views.view import view_controller
from recorders.errors import CheckFailed, ConfigError
from recorders.files.anonymous_file import write_json
from recorders.messages.topics import JOINT_STATES
from recorders.reading.reader import LogReader
from recorders.rerun_scene.hands import FrontalPlane
from recorders.rerun_scene.recording import Destination, record_motion
from replay.sources.schedule import Schedule

ROBOT = "asimo"

PAPER_CM = {"circles": 2.79, "eight": 2.95}
"""The paper's errors, each of the network trained on that pattern (section III-B)."""

CONTROLLER, REPORT, RECORDING, SUMMARY = _RESULTS = ("controller.npz", "report.png", "robot.rrd", "summary.json")

_DEPLOYMENT_PERIOD_NS = 100_000_000  # the paper presents targets at 10 Hz


@dataclass(frozen=True, eq=False)
class Demo:
    """Results of a run of the demo.

    Attributes
    ----------
    trials : (Trial, Trial, Trial)
        The controller on pattern 1, pattern 2 and the drawing, in this order.
    errors_cm : list of float
        Eq. (10) of every epoch.
    zenoh_digest, file_digest : str
        State digests of the learner fed over Zenoh and of the one trained from the file.
    seconds : dict of str to float
        Time of each stage [s].
    controller, logs : Path and list of Path
        Files.
    published : dict of str to str, or None
        Digests that are published for the same settings, as `digests` has them.
    deployable, self_taught : Deployable
        Controllers of the rule to deploy: taught, and without a teacher.
    """

    trials: Trials
    errors_cm: list[float]
    zenoh_digest: str
    file_digest: str
    seconds: dict[str, float]
    controller: Path
    logs: list[Path]
    published: dict[str, str] | None
    deployable: Deployable
    self_taught: Deployable

    @property
    def digests(self) -> dict[str, str]:
        """Digest of each file, by name: content hashes of the logs, states of the controllers."""
        deployables = self.deployable, self.self_taught
        logs = [*self.logs, *(found.log for found in deployables)]
        contents = {log.name: str(LogReader(log).manifest["content_sha256"]) for log in logs}
        states = {found.controller.name: found.file_digest for found in deployables}
        return {**contents, self.controller.name: self.file_digest, **states}

    def summary(self, out: Path) -> dict[str, Any]:
        """Return the summary, with paths relative to the folder `out`."""
        trained, other, drawing = self.trials
        return {
            "train_cm": trained.errors.mean_cm,
            "other_cm": other.errors.mean_cm,
            **{f"demonstration_{hand}_cm": error_cm for hand, error_cm in drawing.errors.hands_cm.items()},
            "teacher_cm": trained.teacher.mean_cm if trained.teacher else None,
            "linear_cm": trained.linear.mean_cm if trained.linear else None,
            "file_digest": self.file_digest,
            "zenoh_digest": self.zenoh_digest,
            "digests": self.digests,
            "as_published": None if self.published is None else self.digests == self.published,
            "seconds": self.seconds,
            "controller": str(self.controller.relative_to(out)),
            "logs": [str(log.relative_to(out)) for log in self.logs],
            **self._of_deployables(out),
        }

    def _of_deployables(self, out: Path) -> dict[str, Any]:
        entries = dict[str, Any]()
        for name, found in (("deployable", self.deployable), ("self_taught", self.self_taught)):
            entries |= {
                name: str(found.controller.relative_to(out)),
                f"{name}_log": str(found.log.relative_to(out)),
                f"{name}_cm": found.errors_cm(),
                f"{name}_live_digest": found.live_digest,
                f"{name}_file_digest": found.file_digest,
            }
        return entries


def run_demo(
    out: Path, *, seed: int = 0, epochs: int = 150, duration_s: float = DURATION_S, view: LiveView | None = None
) -> Demo:
    """Run the whole chain in the folder `out`, replacing what an earlier run left there.

    With a `view`, exploration and learning are shown as they go on, and the controller at the end.

    Parameters
    ----------
    out : Path
        Folder of the results.
    seed, epochs : int
        Of everything that is drawn, and of the network's training.
    duration_s : float
        Of the explorations that the controllers to deploy learn from [s].
    view : LiveView, optional
        Viewer.

    Raises
    ------
    CheckFailed
        If a learner that learned live and one trained from its log differ; everything is written before.
    ReenactError
        If a stage fails.
    """
    _clear_folder(out)
    seconds: dict[str, float] = {}
    logs = [out / f"{pattern}.mcap" for pattern in PATTERNS]
    robot = load_robot(ROBOT)
    with deployables.explorations(out, robot=ROBOT, seed=seed, duration_s=duration_s) as (taught, self_taught):
        with _stage("explore", seconds) as advance:
            _explore_both(robot, logs, seed=seed, advance=advance, view=view)
        zenoh_digest, trainer = _learn(out / CONTROLLER, logs[0], seconds, seed=seed, epochs=epochs, view=view)
        with _stage("explore_volume", seconds):
            taught()
        with _stage("learn_deployable", seconds):
            deployable = learn_taught(out, logs, robot=robot, seed=seed)
        with _stage("explore_without_teacher", seconds):
            digest = self_taught()
        with _stage("learn_self_taught", seconds):
            alone = learn_self_taught(out, logs, seed=seed, live_digest=digest)
    trials = _evaluate(out, logs, robot, deployable.trials[2], trainer.errors_cm, seconds, view)
    result = Demo(
        trials=trials,
        errors_cm=trainer.errors_cm,
        zenoh_digest=zenoh_digest,
        file_digest=str(trainer.result()["digest"]),
        seconds=seconds,
        controller=out / CONTROLLER,
        logs=logs,
        published=published_digests(seed=seed, epochs=epochs, duration_s=duration_s),
        deployable=deployable,
        self_taught=alone,
    )
    write_json(out / SUMMARY, result.summary(out))
    _check(result)
    return result


def _learn(
    controller: Path, log: Path, seconds: dict[str, float], *, seed: int, epochs: int, view: LiveView | None
) -> tuple[str, Trainer]:
    """Learn a log over Zenoh, which writes the controller, and from the file; returns digest and trainer."""
    schedule = Schedule(epochs=epochs)
    with _stage("learn_over_zenoh", seconds) as advance:
        viewer = () if view is None else ("--viewer", view.url)
        digest = learn_over_zenoh(log, controller, seed=seed, schedule=schedule, advance=advance, options=viewer)
    with _stage("learn_from_file", seconds) as advance:
        trainer = train(
            [log],
            schedule=schedule,
            config=LearnerConfig(seed=seed),
            on_cycle=lambda cycle: advance((cycle.epoch + 1) / epochs),
        )
    return digest, trainer


def _check(result: Demo) -> None:
    if result.zenoh_digest != result.file_digest:
        raise CheckFailed(
            f"expected one state, found {result.zenoh_digest[:16]} learned over Zenoh and {result.file_digest[:16]} "
            "from the file"
        )
    result.deployable.check()
    result.self_taught.check()


def results_table(result: Demo) -> Table:
    """Return the errors beside the teacher's, the baseline's and the paper's, for the terminal."""
    table = Table(title="Distance of the hands from their targets, mean over time, in cm", title_justify="left")
    table.add_column("motion")
    for heading in ("learned", "left", "right", "worst", "teacher", "linear", "paper"):
        table.add_column(heading, justify="right")
    labels = ("circles (trained)", "eight (never seen)", "right-hand drawing (generated, never seen)")
    for label, trial in zip(labels, result.trials, strict=True):
        errors, paper = trial.errors, PAPER_CM.get(trial.name)
        beside = [part.mean_cm if part else None for part in (trial.teacher, trial.linear)]
        cells = [errors.mean_cm, *errors.hands_cm.values(), errors.max_cm, *beside, paper]
        table.add_row(label, *("-" if cell is None else f"{cell:.2f}" for cell in cells))
    table.caption = "linear: least squares on the same data. paper: its network trained on that very pattern."
    table.caption_justify = "left"
    return table


@contextmanager
def _stage(name: str, seconds: dict[str, float]) -> Iterator[Callable[[float], None]]:
    began_s = time.monotonic()
    with console.progress(name.replace("_", " ")) as advance:
        yield advance
        advance(1.0)
    seconds[name] = round(time.monotonic() - began_s, 2)


def _explore_both(
    robot: RobotConfig, logs: list[Path], *, seed: int, advance: Callable[[float], None], view: LiveView | None = None
) -> None:
    """Explore pattern 1 here and pattern 2, which is shorter, in a process beside it."""
    options = ("--robot", ROBOT, "--seed", seed, "--out", logs[1].resolve(), "--overwrite")
    with beside("explore", "--motion", PATTERNS[1], *options) as other:
        watched = None if view is None else MotionView(view, robot, joints_topic=JOINT_STATES, title=PATTERNS[0])
        explore(
            robot,
            load_motion(PATTERNS[0], robot),
            seed=seed,
            out=logs[0],
            overwrite=True,
            progress=advance,
            on_message=(lambda topic, message, time_ns: None) if watched is None else watched.feed,
        )
        if watched is not None:
            watched.flush()
        other()


def _evaluate(
    out: Path,
    logs: list[Path],
    robot: RobotConfig,
    deployed: Trial,
    errors_cm: list[float],
    seconds: dict[str, float],
    view: LiveView | None,
) -> Trials:
    """Try the controller on every motion, and draw and show what it does."""
    with _stage("evaluate", seconds):
        controller = Controller.load(out / CONTROLLER)
        trials = try_motions(controller, logs)
    with _stage("report", seconds):
        _draw(out / REPORT, robot, trials, deployed, errors_cm)
        _record(out / RECORDING, controller, trials[1])
        if view is not None:
            _show(view, out / CONTROLLER, motion=PATTERNS[1])
    return trials


def _draw(path: Path, robot: RobotConfig, trials: Trials, deployed: Trial, errors_cm: list[float]) -> None:
    titles = ("Circles (trained)", "Eight (never seen)", "Right-hand drawing (generated)\nnever seen")
    trained = trials[0]

    def test(title: str, trial: Trial) -> MotionTest:
        """Return a trial as it is drawn."""
        return MotionTest(title, trial.targets, trial.reached, trial.errors, lateral=robot.lateral, up=robot.up)

    draw_report(
        path,
        tests=[test(title, trial) for title, trial in zip(titles, trials, strict=True)],
        errors_cm=errors_cm,
        teacher_cm=trained.teacher.mean_cm if trained.teacher else float("nan"),
        linear_cm=trained.linear.mean_cm if trained.linear else float("nan"),
        paper_cm=PAPER_CM["circles"],
        title=f"The paper's rule, learned from {len(trained.targets)} samples; below right, the rule to deploy",
        beside=test("The same drawing, never seen:\nthe rule to deploy, taught", deployed),
    )


def _record(path: Path, controller: Controller, trial: Trial) -> None:
    robot = robot_of(controller)
    record_motion(
        path,
        urdf_text=robot.plain_urdf,
        joint_names=robot.joints,
        times_ns=np.arange(len(trial.targets)) * _DEPLOYMENT_PERIOD_NS,
        joints=trial.joints,
        targets=trial.asked,
        reached=trial.reached,
        title=f"learned controller on {trial.name}",
        plane=FrontalPlane(robot.lateral, robot.up),
    )


def _show(view: LiveView, controller: Path, *, motion: str) -> None:
    view.attempt(lambda: view_controller(controller, Destination(url=view.url), motion=motion))


def _clear_folder(out: Path) -> None:
    """Make the folder, and take away what an earlier run left that a failed one would leave standing."""
    try:
        out.mkdir(parents=True, exist_ok=True)
        for name in (*_RESULTS, *CONTROLLERS):
            (out / name).unlink(missing_ok=True)
    except OSError as error:
        raise ConfigError(f"{out}: expected a folder to write to: {error.strerror}") from error
