"""The main job end to end: explore, record, replay over Zenoh, learn, check against the recording, report."""

import json
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from pipeline.evaluation.trials import Trial, evaluate_motion, robot_of
from pipeline.exploration.explore import explore
from pipeline.learner.controller import Controller
from pipeline.learner.rules.reservoir.config import LearnerConfig
from pipeline.learner_node.node import replay
from pipeline.motions.motion import load_motion
from pipeline.motions.names import PATTERNS
from pipeline.published import published_digests
from pipeline.robot.config import RobotConfig, load_robot
from pipeline.terminal import console
from pipeline.training.trainer import train
from pipeline.views.figures import MotionTest, draw_report
from pipeline.views.live import LiveView
from pipeline.views.motion import MotionView
from pipeline.views.view import view_controller
from recorders.errors import CheckFailed, ConfigError, WireError
from recorders.files.anonymous_file import write_json
from recorders.messages.topics import JOINT_STATES
from recorders.reading.reader import LogReader
from recorders.rerun_scene.hands import FrontalPlane
from recorders.rerun_scene.recording import Destination, record_motion
from recorders.wire.loopback import free_endpoint
from recorders.wire.session import SessionConfig
from replay.sources.schedule import Schedule
from replay.sources.scheduled import Replay
from replay.transports.sender_config import SenderConfig

DRAWING = "right_hand_drawing"
"""Stands for the user's demonstration; generated, see its file."""

ROBOT = "asimo"

PAPER_CM = {"circles": 2.79, "eight": 2.95}
"""The paper's errors, each of the network trained on that pattern (section III-B)."""

CONTROLLER, REPORT, RECORDING, SUMMARY = _RESULTS = ("controller.npz", "report.png", "robot.rrd", "summary.json")

_LEARNER_START_S = 60.0  # a cold start compiles the kernels
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
    """

    trials: tuple[Trial, Trial, Trial]
    errors_cm: list[float]
    zenoh_digest: str
    file_digest: str
    seconds: dict[str, float]
    controller: Path
    logs: list[Path]
    published: dict[str, str] | None

    @property
    def digests(self) -> dict[str, str]:
        """Digest of each file, by name: content hashes of the logs, the state of the controller."""
        contents = {log.name: str(LogReader(log).manifest["content_sha256"]) for log in self.logs}
        return {**contents, self.controller.name: self.file_digest}

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
        }


def run_demo(out: Path, *, seed: int = 0, epochs: int = 150, view: LiveView | None = None) -> Demo:
    """Run the whole chain in the folder `out`, replacing what an earlier run left there.

    With a `view`, exploration and learning are shown as they go on, and the controller at the end.

    Raises
    ------
    CheckFailed
        If the learner fed over Zenoh and the one trained from the file differ; everything is written before.
    ReenactError
        If a stage fails.
    """
    _clear_folder(out)
    seconds: dict[str, float] = {}
    logs = [out / f"{pattern}.mcap" for pattern in PATTERNS]
    robot = load_robot(ROBOT)
    with _stage("explore", seconds) as advance:
        _explore_both(robot, logs, seed=seed, advance=advance, view=view)
    controller_path = out / CONTROLLER
    with _stage("learn_over_zenoh", seconds) as advance:
        viewer = () if view is None else ("--viewer", view.url)
        zenoh_digest = _learn_over_zenoh(
            logs[0], controller_path, seed=seed, epochs=epochs, advance=advance, options=viewer
        )
    with _stage("learn_from_file", seconds) as advance:
        trainer = train(
            logs[:1],
            schedule=Schedule(epochs=epochs),
            config=LearnerConfig(seed=seed),
            on_cycle=lambda cycle: advance((cycle.epoch + 1) / epochs),
        )
    with _stage("evaluate", seconds):
        controller = Controller.load(controller_path)
        trials = (
            evaluate_motion(controller, logs[0]),
            evaluate_motion(controller, logs[1]),
            evaluate_motion(controller, DRAWING),
        )
    with _stage("report", seconds):
        _draw(out / REPORT, robot, trials, trainer.errors_cm)
        _record(out / RECORDING, controller, trials[1])
        if view is not None:
            _show(view, controller_path, motion=PATTERNS[1])
    file_digest = str(trainer.result()["digest"])
    published = published_digests(seed=seed, epochs=epochs)
    result = Demo(trials, trainer.errors_cm, zenoh_digest, file_digest, seconds, controller_path, logs, published)
    write_json(out / SUMMARY, result.summary(out))
    if zenoh_digest != file_digest:
        raise CheckFailed(
            f"expected one state, found {zenoh_digest[:16]} learned over Zenoh and {file_digest[:16]} from the file"
        )
    return result


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
    with _beside("explore", "--motion", PATTERNS[1], *options) as other:
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


def _learn_over_zenoh(
    log: Path,
    controller: Path,
    *,
    seed: int,
    epochs: int,
    advance: Callable[[float], None],
    options: tuple[str, ...] = (),
) -> str:
    """Feed a learner in a process of its own over loopback; return its state digest."""
    endpoint = free_endpoint()
    with _beside("learn", "--connect", endpoint, "--seed", seed, "--out", controller.resolve(), *options) as learner:
        replay(
            Replay([log], Schedule(epochs=epochs)),
            session=SessionConfig(listen=(endpoint,)),
            sender=SenderConfig(wait_s=_LEARNER_START_S),
            on_progress=advance,
        )
        return str(learner()["digest"])


@contextmanager
def _beside(*arguments: object) -> Iterator[Callable[[], dict[str, Any]]]:
    """Run a verb in a process of its own, and end it with the block.

    Yields
    ------
    callable
        Waits for the process and returns its result; raises WireError with its complaint if it failed.
    """
    command = [sys.executable, "-m", "pipeline", *map(str, arguments), "--json"]
    with subprocess.Popen(  # noqa: S603  # our own program, no shell
        command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:

        def result() -> dict[str, Any]:
            """Return the result that the process printed."""
            printed, complaints = process.communicate()
            if process.returncode != 0:
                line = (complaints.strip().splitlines() or [f"ended with status {process.returncode}"])[-1]
                kind = CheckFailed if process.returncode == CheckFailed.exit_status else WireError
                raise kind(f"{arguments[0]}: {line.removeprefix('reenact: ')}")
            return dict(json.loads(printed))

        try:
            yield result
        except WireError:
            if process.poll():
                result()  # the reason for which the other process ended is worth more than that it does not answer
            raise
        finally:
            process.terminate()


def _draw(path: Path, robot: RobotConfig, trials: tuple[Trial, Trial, Trial], errors_cm: list[float]) -> None:
    titles = ("Circles (trained)", "Eight (never seen)", "Right-hand drawing (generated)\nnever seen")
    trained = trials[0]
    draw_report(
        path,
        tests=[
            MotionTest(title, trial.targets, trial.reached, trial.errors, lateral=robot.lateral, up=robot.up)
            for title, trial in zip(titles, trials, strict=True)
        ],
        errors_cm=errors_cm,
        teacher_cm=trained.teacher.mean_cm if trained.teacher else float("nan"),
        linear_cm=trained.linear.mean_cm if trained.linear else float("nan"),
        paper_cm=PAPER_CM["circles"],
        title=f"Learned from one pattern of {len(trained.targets)} samples: both hands on it and on motions never seen",
    )


def _record(path: Path, controller: Controller, trial: Trial) -> None:
    robot = robot_of(controller)
    record_motion(
        path,
        urdf_text=robot.plain_urdf,
        joint_names=robot.joints,
        times_ns=np.arange(len(trial.targets)) * _DEPLOYMENT_PERIOD_NS,
        joints=trial.joints,
        targets=trial.targets.reshape(trial.reached.shape),
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
        for name in _RESULTS:
            (out / name).unlink(missing_ok=True)
    except OSError as error:
        raise ConfigError(f"{out}: expected a folder to write to: {error.strerror}") from error
