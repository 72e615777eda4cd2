"""Logs and controllers as Rerun recordings: what `view` shows or saves."""

import logging
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from pipeline.evaluation.trials import evaluate_motion, robot_of
from pipeline.learner.controller import Controller
from pipeline.robot.config import RobotConfig, load_robot
from pipeline.robot.kinematics import Kinematics
from pipeline.robot.recorded import require_recorded_robot
from pipeline.views.learning import plane_of
from pipeline.views.network import NetworkView
from pipeline.views.orientations import orientations
from pipeline.views.rows import JOINT_TOPICS, MotionRows
from recorders.cdr.codec import decode
from recorders.containers.opening import open_log
from recorders.containers.reader import Reader
from recorders.errors import LogError
from recorders.messages.message_types import PoseStamped
from recorders.messages.topics import hand_measured, hand_target, type_of
from recorders.reading.parts import Log
from recorders.rerun_scene.blueprint import controller_blueprint, motion_blueprint, stack_points
from recorders.rerun_scene.learning import log_activity, send_learning_styles, send_network, send_parts
from recorders.rerun_scene.recording import Destination, send_motion
from recorders.rerun_scene.robot import RobotModel
from recorders.rerun_scene.track import TIMELINE, Instants, Track
from recorders.text.wording import names_text
from replay.sources.scheduled import naming, renamed

logger = logging.getLogger(__name__)

PERIOD_NS = 100_000_000
"""Time from one target to the next at deployment; the paper's 10 Hz."""

_NO_RENAMES: Mapping[str, str] = {}


def view_log(
    path: Log, destination: Destination, *, robot: str | None = None, renames: Mapping[str, str] = _NO_RENAMES
) -> int:
    """Send a log as a recording: the robot by its measured joints, else by the commands that it was given.

    Time is the log's own, from its first message on. Reached hands are those of the posture, by forward kinematics, and
    compared with the targets that were in force before it; in a log without targets with the hands as measured, if it
    has them.

    Parameters
    ----------
    path : Path or Parts
        The log, or a session in parts.
    destination : Destination
        File or viewer.
    robot : str, optional
        Name or folder of the robot, for logs that carry none.
    renames : mapping of str to str
        Our topic names for those that the log uses.

    Returns
    -------
    int
        Postures shown.

    Raises
    ------
    LogError
        The log cannot be read, has targets of some hands alone, no postures, or no robot, or the recording cannot be
        written.
    ReenactError
        A message or the robot is not what it should be.
    """
    reader = open_log(path)
    config = load_robot(robot) if robot is not None else _recorded_robot(reader)
    topics = {renames.get(topic, topic): kind for topic, kind in reader.topics.items()}
    asked = _asked(reader, topics, config.hand_names)
    rows = MotionRows(config, joints_topic=_joints_topic(reader, renames, config.hand_names, asked), asked=asked)
    with naming(path):
        for record in renamed(reader, renames, rows.topics):
            rows.feed(record.topic, decode(record.type, record.data), record.log_time_ns)
        track = rows.take()
    if track is None:
        raise LogError(f"{path}: expected postures after the first targets of all hands, found none")
    send_motion(
        destination,
        track,
        RobotModel.load(config.plain_urdf, config.joints),
        plane=plane_of(config),
        recording_id=track.recording_id(config.urdf_text, "log", path.name),
        title=path.name,
        kind="log",
        blueprint=_log_blueprint(track, config, learning=bool(rows.errors)),
        more=_errors_of(rows, config.hand_names),
    )
    return len(track.times_ns)


def view_controller(path: Path, destination: Destination, *, motion: str = "circles") -> int:
    """Send a learned controller as a recording: what it makes of a motion, and its network; returns the ticks shown.

    Raises
    ------
    ControllerError
        The controller cannot be read.
    MotionError
        The motion cannot be.
    LogError
        The recording cannot be written.
    """
    controller = Controller.load(path)
    trial = evaluate_motion(controller, motion)
    robot = robot_of(controller)
    network = NetworkView(controller)
    track = Track.checked(
        joint_count=len(robot.joints),
        hand_count=len(robot.hands),
        times_ns=np.arange(len(trial.targets)) * PERIOD_NS,
        joints=trial.joints,
        targets=trial.asked,
        reached=trial.reached,
        orientations=orientations(Kinematics(robot), trial.targets, trial.joints),
    )
    errors_cm, parts = _published_errors(controller), network.parts(controller, trial.targets)

    def send(recording: rr.RecordingStream) -> None:
        """Send to a recording."""
        changes = np.concatenate([*network.moved(controller).values(), np.empty(0)])
        send_network(recording, network.spread(controller) | {"weights": changes}, errors_cm=errors_cm)
        activity = network.activity(controller, trial.targets)
        if activity is not None:
            log_activity(recording, activity, static=True)
        if parts is not None:
            send_parts(recording, Instants(TIMELINE, np.asarray(track.times_ns)), parts.curves, parts.lines)

    plane, title = plane_of(robot), f"{path.name} on {trial.name}"
    points, top_cm = stack_points(track.targets, track.reached), float(track.errors_cm.max())
    send_motion(
        destination,
        track,
        RobotModel.load(robot.plain_urdf, robot.joints),
        plane=plane,
        recording_id=track.recording_id(controller.digest, "controller", title),
        title=title,
        kind="controller",
        blueprint=controller_blueprint(
            points,
            plane,
            joints=len(robot.joints),
            top_cm=top_cm,
            spread=network.shown.spread,
            activity=bool(network.shown.activity),
            parts=parts is not None,
        ),
        more=send,
    )
    return len(track.times_ns)


def _log_blueprint(track: Track, robot: RobotConfig, *, learning: bool) -> rrb.Blueprint:
    """Return the layout for a log: its hands in the plane of the robot's pattern, and errors as far as they go."""
    return motion_blueprint(
        stack_points(track.targets, track.reached),
        plane_of(robot),
        joints=len(robot.joints),
        top_cm=float(track.errors_cm[track.plotted].max()),
        learning=learning,
    )


def _recorded_robot(reader: Reader) -> RobotConfig:
    return require_recorded_robot(reader, has_option=True)


def _asked(reader: Reader, topics: Mapping[str, str], hands: Sequence[str]) -> Callable[[str], str] | None:
    """Return what postures are compared with: targets, hands as measured where there are none, or nothing; says so."""
    if any(hand_target(hand) in topics for hand in hands):
        return hand_target
    if all(topics.get(hand_measured(hand)) in ("", PoseStamped.TYPE) for hand in hands):
        logger.info(f"{reader.path} has no targets: hands as measured stand for them")
        return hand_measured
    logger.info(f"{reader.path} has neither targets nor hands as measured: the hands are where its joints put them")
    return None


def _joints_topic(
    reader: Reader, renames: Mapping[str, str], hands: Sequence[str], asked: Callable[[str], str] | None
) -> str:
    topics = {renames.get(topic, topic): kind for topic, kind in reader.topics.items()}
    found = [topic for topic in JOINT_TOPICS if topic in topics]
    others = [topic for topic in reader.topics if topic not in renames and topic not in found]
    targets = [asked(hand) for hand in hands] if asked else []
    if not found or not set(targets) <= topics.keys():
        wanted = f"{names_text(targets)} and " if targets else ""
        raise LogError(
            f"{reader.path}: expected {wanted}one of {names_text(JOINT_TOPICS)}, "
            f"found {names_text(sorted(found + others)) or 'nothing'}; give foreign names with --map"
        )
    for topic in (*targets, found[0]):
        if topics[topic] not in ("", type_of(topic)):
            raise LogError(f"{reader.path}: {topic}: expected {type_of(topic)}, found {topics[topic][:80]!r}")
    return found[0]


def _published_errors(controller: Controller) -> list[float]:
    """Return the error of every epoch, if the controller has it: its writer noted it, and nobody checks it."""
    errors = controller.provenance.get("errors_cm")
    if not isinstance(errors, list):
        return []
    return [float(value) for value in errors if type(value) in (int, float) and np.isfinite(value)]


def _errors_of(rows: MotionRows, hands: Sequence[str]) -> Callable[[rr.RecordingStream], None]:
    """Return a callable that adds the errors that a learner published, if one did."""

    def send(recording: rr.RecordingStream) -> None:
        """Send to a recording."""
        if not rows.errors:
            return
        send_learning_styles(recording, hands)
        index = Instants(TIMELINE, np.array([time_ns for time_ns, _ in rows.errors], dtype=np.int64)).columns()
        for hand, values in zip(hands, np.array([errors for _, errors in rows.errors]).T, strict=True):
            recording.send_columns(f"learning/error/{hand}", index, rr.Scalars.columns(scalars=values))

    return send
