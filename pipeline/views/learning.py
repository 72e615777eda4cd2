"""View of a learner, once for each evaluated cycle, without touching what is learned."""

from collections.abc import Callable

import numpy as np

from pipeline.arrays import Floats
from pipeline.evaluation.errors import hand_errors
from pipeline.evaluation.trials import robot_of
from pipeline.learner.controller import Controller
from pipeline.learner.rule import Settings
from pipeline.robot.config import RobotConfig
from pipeline.robot.coordinates import positions_of
from pipeline.robot.kinematics import Kinematics
from pipeline.training.checkpoints import CheckpointConfig
from pipeline.training.run import CycleReport, Steps
from pipeline.training.trainer import Trainer
from pipeline.views.live import LiveView
from pipeline.views.network import NetworkView
from pipeline.views.orientations import orientations
from recorders.messages.phase import EVALUATE
from recorders.rerun_scene.blueprint import EPOCHS, learning_blueprint, stack_points
from recorders.rerun_scene.hands import FrontalPlane, HandScene
from recorders.rerun_scene.learning import log_activity, log_drift, log_errors, send_learning_styles
from recorders.rerun_scene.robot import RobotModel
from recorders.rerun_scene.track import Instants, Track

TICKS = "tick"
"""Timeline of a learner that learns live, without epochs."""

_MOST_ROWS = 4096  # steps of a cycle that are shown
_STRIDE = 7  # ticks from one epoch's posture to the next: the robot moves through the motion while it is learned
_PICTURE_EVERY, _ACTIVITY_EVERY = 3, 15  # epochs: numbers cost little, paths more, the activity most
_LIVE_TICKS = 64  # between two pictures of a learner without epochs
_CM_PER_M = 100.0


class LearningView:
    """Shows a learner: its motion and errors, the drift of weights, a and b, and the activity of the reservoir.

    Parameters
    ----------
    view : LiveView
        The viewer.
    live : bool
        Whether there are no epochs: a picture every so many ticks then.
    """

    def __init__(self, view: LiveView, *, live: bool = False) -> None:
        self._view = view
        self._live = live
        self._steps: list[tuple[Floats, Floats]] = []  # u and outputs
        self._rows = 0
        self._kinematics: Kinematics | None = None  # known with the robot
        self._scene: _LearningScene | None = None
        self._shown_ticks = 0

    def take(self, steps: Steps) -> None:
        """Keep steps for the next picture."""
        if self._live and self._rows >= _LIVE_TICKS:
            self._clear()
        if self._rows < _MOST_ROWS:
            self._steps.append((steps.u.copy(), steps.outputs))
            self._rows += len(steps.u)

    def cycle(self, report: CycleReport, learned: Callable[[], Controller]) -> None:
        """Show an evaluated cycle that is over."""
        if report.phase == EVALUATE and report.hands_cm is not None and not self._live:
            self._view.attempt(lambda: self._show(EPOCHS, report.epoch, learned(), report.hands_cm))
        self._clear()

    def progress(self, ticks: int, learned: Callable[[], Controller]) -> None:
        """Show a learner without epochs, if it has gone far enough."""
        if self._live and ticks - self._shown_ticks >= _LIVE_TICKS:
            self._shown_ticks = ticks
            self._view.attempt(lambda: self._show(TICKS, ticks, learned(), None))

    def _clear(self) -> None:
        self._steps.clear()
        self._rows = 0

    def _show(self, timeline: str, index: int, controller: Controller, hands_cm: tuple[float, ...] | None) -> None:
        if not self._steps:
            return
        u, outputs = (np.concatenate(parts) for parts in zip(*self._steps, strict=True))
        joints = outputs[:, u.shape[1] :]
        self._kinematics = self._kinematics or Kinematics(robot_of(controller))
        if hands_cm is None:
            hands_cm = tuple((hand_errors(self._kinematics, joints, u).mean(axis=0) * _CM_PER_M).tolist())
        self._scene = self._scene or _LearningScene(
            self._view, controller, self._kinematics, timeline, u, max(hands_cm)
        )
        self._scene.show(index, controller, u, joints, hands_cm)


class _LearningScene:
    """The recording of one learner, once it is known which robot learns."""

    def __init__(
        self,
        view: LiveView,
        controller: Controller,
        kinematics: Kinematics,
        timeline: str,
        targets: Floats,
        top_cm: float,
    ) -> None:
        robot, plane = kinematics.robot, plane_of(kinematics.robot)
        self._timeline = timeline
        self._kinematics = kinematics
        self._network = NetworkView(controller)
        self._model = RobotModel.load(robot.plain_urdf, robot.joints)
        shown = self._network.shown
        blueprint = learning_blueprint(
            stack_points(positions_of(robot, targets)),
            plane,
            joints=len(robot.joints),
            timeline=timeline,
            top_cm=top_cm,
            spread=shown.spread,
            activity=bool(shown.activity),
        )
        self._recording = view.open(title=f"{robot.name} learns", blueprint=blueprint, kind="learning")
        self._model.send_static(self._recording)
        self._hands = HandScene(self._recording, plane).send_static()
        send_learning_styles(self._recording, plane.hands, list(shown.drift), spread=list(shown.spread))
        self._shown = 0

    def show(
        self,
        index: int,
        controller: Controller,
        u: Floats,
        joints: Floats,
        hands_cm: tuple[float, ...],
    ) -> None:
        """Show the learner at an instant."""
        self._recording.set_time(self._timeline, sequence=index)
        log_errors(self._recording, dict(zip(self._kinematics.robot.hand_names, hands_cm, strict=True)))
        log_drift(self._recording, self._network.spread(controller), moved=self._network.moved(controller))
        if self._timeline == TICKS or self._shown % _PICTURE_EVERY == 0:
            self._show_motion(index, u, joints)
        if self._shown % _ACTIVITY_EVERY == 0:
            activity = self._network.activity(controller, u)
            if activity is not None:
                log_activity(self._recording, activity)
        self._shown += 1

    def _show_motion(self, index: int, u: Floats, joints: Floats) -> None:
        """Show the whole paths, and the robot at one of their points."""
        reached = self._kinematics.hands_along(joints)
        targets = positions_of(self._kinematics.robot, u)
        now = slice(at := index * _STRIDE % len(u), at + 1) if self._timeline == EPOCHS else slice(-1, None)
        instants = Instants(self._timeline, np.array([index], dtype=np.int64))
        self._model.send(self._recording, instants, joints[now])
        turned = orientations(self._kinematics, u[now], joints[now])
        track = Track(np.zeros(1, dtype=np.int64), joints[now], targets[now], reached[now], orientations=turned)
        self._hands.send(instants, track)
        self._hands.log_paths(targets, reached)


class ViewedTrainer(Trainer):
    """Trainer whose steps a viewer shows, too; the view changes nothing in it.

    Parameters
    ----------
    view : LearningView
        Shown all steps, cycles and progress.
    config, robot, pairs, checkpoint, on_cycle, on_progress
        As for `Trainer`.
    """

    def __init__(
        self,
        config: Settings,
        *,
        view: LearningView,
        robot: RobotConfig | None = None,
        pairs: str | None = None,
        checkpoint: CheckpointConfig | None = None,
        on_cycle: Callable[[CycleReport], None] = lambda report: None,
        on_progress: Callable[[int, float | None], None] = lambda ticks, share: None,
    ) -> None:
        def progress(ticks: int, share: float | None) -> None:
            """Show progress, after the caller's own."""
            on_progress(ticks, share)
            view.progress(ticks, self.controller)

        super().__init__(
            config, robot=robot, pairs=pairs, checkpoint=checkpoint, on_cycle=on_cycle, on_progress=progress
        )
        self._viewed = view
        super().show_steps_to(view.take)
        self.report_to(lambda report: view.cycle(report, self.controller))

    def show_steps_to(self, listener: Callable[[Steps], None]) -> None:
        """Show the steps to a listener too."""

        def both(steps: Steps) -> None:
            """Pass the steps to both listeners."""
            self._viewed.take(steps)
            listener(steps)

        super().show_steps_to(both)


def plane_of(robot: RobotConfig) -> FrontalPlane:
    """Return a robot's hands and the plane in which they draw."""
    return FrontalPlane(robot.lateral, robot.up, robot.hand_names)
