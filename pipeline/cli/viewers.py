"""Options by which a verb shows in Rerun's viewer what happens, listed once."""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from pipeline.learner.controller import Controller
    from pipeline.robot.config import RobotConfig
    from pipeline.training.trainer import Trainer
    from pipeline.views.live import LiveView
    from recorders.messages.message_types import Message
    from recorders.messages.record import RecordedMessage


# Read when Rerun is loaded, which is after the verbs are: where one fails, it would add many lines to the one of ours.
os.environ.setdefault("RUST_LOG", "off")


@dataclass(frozen=True)
class ViewOptions:
    """Viewer of a verb: none, one of its own, or one that runs."""

    view: Annotated[bool, typer.Option("--view", help="Show in Rerun's viewer what happens.")] = False
    viewer: Annotated[
        str | None,
        typer.Option(help="Like --view, in a viewer that runs: rerun+http://127.0.0.1:9876/proxy.", metavar="URL"),
    ] = None

    @property
    def wanted(self) -> bool:
        """True if anything is to be shown."""
        return self.view or self.viewer is not None

    @contextmanager
    def open(self) -> "Iterator[LiveView | None]":
        """Yield the viewer; None where none is wanted or can be had."""
        if not self.wanted:
            yield None
            return
        from pipeline.views.live import viewer

        with viewer(self.view, self.viewer) as view:
            yield view

    @contextmanager
    def trainer(self, *, live: bool) -> "Iterator[Callable[..., Trainer]]":
        """Yield the factory of a trainer: one that a viewer shows, or a plain one where there is no viewer."""
        from pipeline.training.trainer import Trainer

        with self.open() as view:
            if view is None:
                yield Trainer
                return
            from pipeline.views.learning import LearningView, ViewedTrainer

            yield partial(ViewedTrainer, view=LearningView(view, live=live))

    @contextmanager
    def robot(self, robot: "RobotConfig", *, title: str) -> "Iterator[Callable[[str, Message, int], None]]":
        """Yield a callable that takes the messages of a moving robot: topic, message, time [ns]."""
        with self.open() as view:
            if view is None:
                yield lambda topic, message, time_ns: None
                return
            from pipeline.views.motion import MotionView
            from recorders.messages.topics import JOINT_STATES

            shown = MotionView(view, robot, joints_topic=JOINT_STATES, title=title)
            yield shown.feed
            shown.flush()

    @contextmanager
    def commands(
        self, controller: "Controller", *, title: str
    ) -> "Iterator[Callable[[bytes, tuple[RecordedMessage, ...]], None] | None]":
        """Yield a callable that takes the commands of a served controller: CDR bytes, and the messages answered.

        None if nothing is to be shown, so that nobody looks for the messages.
        """
        with self.open() as view:
            if view is None:
                yield None
                return
            from pipeline.evaluation.trials import robot_of
            from pipeline.views import motion as motion_view

            with motion_view.answers_shown(view, robot_of(controller), title=title) as answered:
                yield answered
