"""The node `learn --live`: learns from published hand targets and joints, of a robot or a replay."""

import logging
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from pipeline.learner_node.live_learner import LiveConfig, LiveLearner, wanted_types
from pipeline.learner_node.publisher import LearnerPublisher
from pipeline.robot.config import TOML_FILE, URDF_FILE, RobotConfig
from pipeline.robot_node.client import RemoteRobot
from pipeline.robot_node.namespace_checks import RobotCheck
from pipeline.terminal.signals import until_stopped
from pipeline.training.trainer import Trainer
from recorders.errors import ConfigError, WireError
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import TF_STATIC
from recorders.nodes.node import running_node
from recorders.text.wording import names_text
from recorders.wire.keys.ros_keys import RosKeys
from recorders.wire.keys.topic_keys import EVERY_TOPIC, TopicKeys
from recorders.wire.receiver import Receiver, ReceiverConfig
from recorders.wire.session import Session, SessionConfig, open_session
from recorders.writing.writer import LogWriter
from replay.sources.live import live_offer

logger = logging.getLogger(__name__)


def learn_live(
    trainer: Trainer,
    *,
    robot: RobotConfig | None,
    session: SessionConfig,
    receiver: ReceiverConfig,
    config: LiveConfig | None = None,
    metrics_port: int | None = None,
) -> dict[str, Any]:
    """Learn from what anyone publishes, until Ctrl-C, SIGTERM, enough ticks, or the end of a stream that awaits this.

    What cannot be used is refused and changes nothing; see `replay.sources.live.LiveStream`.

    Parameters
    ----------
    trainer : Trainer
        The learner; a checkpoint of its that is there is gone on from, with a presentation of its own.
    robot : RobotConfig, optional
        The robot; if left out, the one that answers in the namespace.
    session, receiver : SessionConfig, ReceiverConfig
        Endpoints; name and namespace.
    config : LiveConfig
        End of learning, and the log to write.
    metrics_port : int, optional
        Port on 127.0.0.1 for Prometheus.

    Returns
    -------
    dict
        `Trainer.result`, and counts of what was refused and missing, as JSON has it.

    Raises
    ------
    ConfigError, ControllerError, LogError, WireError
        If no robot is named and none answers, learning diverged, a checkpoint cannot be gone on from, the log cannot
        be written, or no session can be opened.
    """
    config = config or LiveConfig()
    with open_session(session) as opened, receiver.keys.joined(opened):
        if robot is None:
            robot = _answering(opened, receiver.namespace)
        else:
            RobotCheck(opened, robot.joints, namespace=receiver.namespace, learner=True).warn()
        types = wanted_types(trainer.pairing, robot, config)
        receiver = replace(receiver, topics=types, latched_topics=frozenset({TF_STATIC}) & types.keys())
        with (
            _Recording(config, robot, trainer.pairing.topics(robot.hand_names)) as recording,
            LearnerPublisher(opened, keys=receiver.keys) as publisher,
            Receiver(opened, config=receiver) as receiving,
            until_stopped() as stopped,
        ):
            learner = LiveLearner(trainer, robot, config, receiving, publisher)
            node, namespace = learner.source(receiver.name), receiver.namespace
            with running_node(opened, node, config=session, namespace=namespace, metrics_port=metrics_port):
                what, where = _described(receiver.keys, types), ", ".join(session.listen or session.connect)
                logger.info(f"{receiver.name} learns {robot.name} from {what} at {where}; Ctrl-C ends it")
                return learner.run(stopped, keep=recording.keep, on_choice=recording.state)


def _described(keys: TopicKeys, types: Mapping[str, str]) -> str:
    """Return what is learned from in words: in a ROS domain the topics that are subscribed to."""
    if not isinstance(keys, RosKeys):
        return keys.described(EVERY_TOPIC)
    return f"{names_text(f'{keys.graph_name(topic)} ({types[topic]})' for topic in sorted(types))} in {keys.words}"


def _answering(opened: Session, namespace: str) -> RobotConfig:
    try:
        return RemoteRobot(opened, namespace=namespace).robot
    except WireError as error:
        raise ConfigError(f"{error}; or name the robot with --robot") from error


class _Recording:
    """Log of the messages that are learned from, if one is wanted; it stays as far as it came if learning fails."""

    def __init__(self, config: LiveConfig, robot: RobotConfig, tick: tuple[str, ...]) -> None:
        self._writer: LogWriter | None = None
        self._epochs, self._tick = config.epochs, tick
        if config.record is None:
            return
        self._writer = LogWriter(
            config.record,
            manifest={"kind": "learning", **self._schedule(tick)},
            attachments={URDF_FILE: robot.urdf_text.encode(), TOML_FILE: robot.toml_text.encode()},
            overwrite=config.overwrite,
            rechunk=False,
        )

    def __enter__(self) -> "_Recording":
        return self

    def __exit__(self, *error: object) -> None:
        if self._writer is not None:
            self._writer.close()

    def state(self, tick: tuple[str, ...]) -> None:
        """State the topics of the ticks that are learned from, where they are others than at the beginning."""
        if self._writer is not None and tick != self._tick:
            self._writer.note(self._schedule(tick))

    def keep(self, record: RecordedMessage) -> None:
        """Write a message that is learned from."""
        if self._writer is not None:
            self._writer.copy(record)

    def _schedule(self, tick: tuple[str, ...]) -> dict[str, Any]:
        return {"schedule": live_offer("", epochs=self._epochs, robot={}, tick=tick).schedule}
