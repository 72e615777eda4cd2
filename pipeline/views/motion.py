"""View of a moving robot, from the messages of its session, without holding it up."""

import queue
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from pipeline.robot.config import RobotConfig
from pipeline.views.learning import plane_of
from pipeline.views.live import LiveView
from pipeline.views.rows import MotionRows
from recorders.cdr.codec import decode
from recorders.messages.message_types import JointState, Message
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import JOINT_COMMANDS
from recorders.rerun_scene.blueprint import motion_blueprint, stack_points
from recorders.rerun_scene.hands import HandScene
from recorders.rerun_scene.robot import RobotModel
from recorders.threads import background_thread

_ROWS = 50  # to a send: a second of a robot's state
_REACH_M = 0.12  # about the middle of a pattern: what is to be in sight
_TOP_CM = 3.0
_WAITING = 4096  # messages; of more, the newest are not shown
_PAUSE_S = 0.2


class MotionView:
    """Shows a robot that moves.

    Parameters
    ----------
    view : LiveView
        The viewer.
    robot : RobotConfig
        The robot.
    joints_topic : str
        The topic that postures are taken from.
    title : str
        Name of the recording in the viewer.
    """

    def __init__(self, view: LiveView, robot: RobotConfig, *, joints_topic: str, title: str) -> None:
        self._view = view
        view.attempt(lambda: self._begin(robot, joints_topic, title))

    def feed(self, topic: str, message: Message, time_ns: int) -> None:
        """Take one message, which stands at this time."""
        self._view.attempt(lambda: self._feed(topic, message, time_ns))

    def flush(self) -> None:
        """Show all that has come."""
        self._view.attempt(self._send)

    def _begin(self, robot: RobotConfig, joints_topic: str, title: str) -> None:
        plane = plane_of(robot)
        offsets = _REACH_M * (robot.lateral + robot.up)
        centres = robot.centres
        blueprint = motion_blueprint(
            stack_points(centres - offsets, centres + offsets),
            plane,
            joints=len(robot.joints),
            top_cm=_TOP_CM,
            live=True,
        )
        self._rows = MotionRows(robot, joints_topic=joints_topic)
        self._model = RobotModel.load(robot.plain_urdf, robot.joints)
        self._recording = self._view.open(title=title, blueprint=blueprint, kind="live")
        self._model.send_static(self._recording)
        self._hands = HandScene(self._recording, plane).send_static()

    def _feed(self, topic: str, message: Message, time_ns: int) -> None:
        if topic not in self._rows.topics:
            return
        self._rows.feed(topic, message, time_ns)
        if len(self._rows) >= _ROWS:
            self._send()

    def _send(self) -> None:
        track = self._rows.take()
        if track is not None:
            self._model.send(self._recording, track.instants, track.joints)
            self._hands.send(track.instants, track)


@contextmanager
def answers_shown(
    view: LiveView, robot: RobotConfig, *, title: str
) -> Iterator[Callable[[bytes, tuple[RecordedMessage, ...]], None]]:
    """Show what a served controller answers, on a thread of its own: whoever commands a robot must never wait.

    Yields
    ------
    callable
        Takes the bytes of a command, and the messages that it answers; returns at once.
    """
    waiting: queue.Queue[RecordedMessage | None] = queue.Queue(_WAITING)

    def show() -> None:
        """Show commands until the block ends."""
        shown = MotionView(view, robot, joints_topic=JOINT_COMMANDS, title=title)
        while (record := waiting.get()) is not None:
            view.attempt(lambda: shown.feed(record.topic, decode(record.type, record.data), record.log_time_ns))
            if waiting.empty():
                shown.flush()
                time.sleep(_PAUSE_S)  # what comes meanwhile is sent at once
        shown.flush()

    def answered(command: bytes, messages: tuple[RecordedMessage, ...]) -> None:
        """Queue a command and the messages that it answers."""
        now_ns = time.monotonic_ns()
        for record in (*messages, RecordedMessage(JOINT_COMMANDS, JointState.TYPE, command, 0, now_ns)):
            if not waiting.full():
                waiting.put_nowait(record._replace(log_time_ns=now_ns))

    with background_thread(show, name="viewer", stop=lambda: waiting.put(None), daemon=False):
        yield answered
