"""Ticks as frames of one rate: joints, hands, and what was asked for, of logs that become a dataset."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import Floats
from pipeline.robot.config import RobotConfig
from pipeline.robot.hands import POSE
from recorders.cdr.codec import decode_as
from recorders.containers.lerobot.columns import ACTION, HANDS, STATE, TARGETS, axis_names
from recorders.containers.reader import Reader
from recorders.errors import ConfigError, LogError
from recorders.messages.message_types import JointState, PoseStamped
from recorders.messages.topics import (
    JOINT_COMMANDS,
    SAMPLE_JOINTS,
    SESSION_PHASE,
    hand_measured,
    hand_target,
)
from recorders.text.quantities import seconds_text
from recorders.text.wording import names_text
from recorders.ticks.joiner import JointMap, Tick, TickJoiner
from replay.sources.episodes import episode_spans
from replay.sources.scheduled import naming, renamed

ACTIONS = ("commands", "targets", "none")
"""What the action of a frame may be: joints that were asked for, hands that were, or nothing."""

_EVEN_NS = 10**5  # LeRobot takes times that are so far off
_SECOND = 10**9


def frame_topics(logs: Sequence[Reader], robot: RobotConfig, renames: Mapping[str, str]) -> tuple[str, ...]:
    """Return our names of the topics of a frame: targets and hands as measured where all logs have them, and joints."""
    there = set.intersection(*(_topics(log, renames) for log in logs))
    hands = [hand_target(name) for name in robot.hand_names], [hand_measured(name) for name in robot.hand_names]
    return (*(topic for topics in hands if there.issuperset(topics) for topic in topics), SAMPLE_JOINTS)


def choose_action(
    asked: str | None, logs: Sequence[Reader], topics: Collection[str], renames: Mapping[str, str]
) -> str:
    """Return what the action of a frame is: one of `ACTIONS`, the first that the logs have if none is asked for.

    Raises
    ------
    ConfigError
        If it is none of them, or a log does not have it.
    """
    if asked is not None and asked not in ACTIONS:
        raise ConfigError(f"--action: expected {names_text(ACTIONS)}, found {asked!r:.40}")
    without = [str(log.path) for log in logs if JOINT_COMMANDS not in _topics(log, renames)]
    has = {"commands": not without, "targets": bool(_targets(topics)), "none": True}
    if asked is not None and not has[asked]:
        there = names_text(action for action in ACTIONS if has[action])
        raise ConfigError(f"--action: expected {asked} in every log, found none in one; there is: {there}")
    return asked or next(action for action in ACTIONS if has[action])


def _topics(log: Reader, renames: Mapping[str, str]) -> set[str]:
    return {renames.get(topic, topic) for topic, count in log.counts.items() if count}


def _targets(topics: Collection[str]) -> list[str]:
    return [topic for topic in topics if topic.endswith("/target")]


@dataclass(frozen=True, eq=False)
class Commands:
    """Joints that a robot was asked for, each until the next.

    Attributes
    ----------
    stamps_ns : ndarray, shape (n,)
        When each was [ns], rising.
    values : ndarray, shape (n, joints)
        The joints [rad or m].
    """

    stamps_ns: NDArray[np.int64]
    values: Floats

    @classmethod
    def of(
        cls,
        log: Reader,
        robot: RobotConfig,
        renames: Mapping[str, str],
        *,
        latencies_ns: Mapping[str, int],
        by_log_time: bool,
    ) -> "Commands":
        """Read the commands of a log.

        Parameters
        ----------
        log : Reader
            The log as it was recorded.
        robot : RobotConfig
            Whose joints they are.
        renames : mapping of str to str
            Our topic names for those that the log uses.
        latencies_ns : mapping of str to int
            By topic: how much later its stamps are than what they are of [ns].
        by_log_time : bool
            Whether they are of the times of their recording.

        Raises
        ------
        LogError
            If their stamps do not rise.
        MessageError, JointError
            If one is no such message, or lacks a joint.
        """
        topic = next((foreign for foreign, ours in renames.items() if ours == JOINT_COMMANDS), JOINT_COMMANDS)
        joints, stamps, values = JointMap(robot.joints), list[int](), list[Floats]()
        with naming(log.path):
            for record in log.records(topics=[topic]):
                command = decode_as(JointState, record.data)
                stamp = record.log_time_ns if by_log_time else command.stamp_ns
                stamps.append(stamp - latencies_ns.get(topic, 0))
                values.append(joints.positions(command))
                if len(stamps) > 1 and stamps[-1] < stamps[-2]:
                    raise LogError(f"{topic}: expected stamps that rise, found one that falls; take --action targets")
        return cls(np.array(stamps, np.int64), np.array(values).reshape(-1, len(robot.joints)))

    def at(self, stamps_ns: NDArray[np.int64]) -> NDArray[np.intp]:
        """Return which command holds at some times, the last one by then; -1 before the first."""
        return np.searchsorted(self.stamps_ns, stamps_ns, side="right") - 1


class FrameReader:
    """Reads the ticks of logs as frames.

    Parameters
    ----------
    robot : RobotConfig
        Whose joints and hands they are.
    topics : sequence of str
        Our names of the topics of a frame.
    action : str
        One of `ACTIONS`.

    Attributes
    ----------
    features : dict of str to tuple of str
        Columns, and the names of the numbers of each.
    episodes : list of dict
        By column, the numbers of each episode, shape (n, size).
    dropped : int
        Frames before the first command, which are left out.
    """

    def __init__(self, robot: RobotConfig, topics: Sequence[str], action: str) -> None:
        self._robot, self._topics, self._action = robot, tuple(topics), action
        self._sizes = {hand.name: 7 if hand.controls == POSE else 3 for hand in robot.hands}
        self._hands = dict(self._features_of_hands())
        self.features = {STATE: tuple(robot.joints)}
        for feature, names in self._hands.values():
            self.features[feature] = (*self.features.get(feature, ()), *names)
        if action == "commands":
            self.features[ACTION] = tuple(robot.joints)
        self.episodes: list[dict[str, Floats]] = []
        self.dropped = 0
        self._stamps: list[tuple[str, NDArray[np.int64]]] = []

    def _features_of_hands(self) -> Iterator[tuple[str, tuple[str, tuple[str, ...]]]]:
        """Yield the column of each topic of a hand, and the names of its numbers there."""
        for name, size in self._sizes.items():
            if (topic := hand_measured(name)) in self._topics:
                yield topic, (HANDS + name, axis_names(name, size))
        for name, size in self._sizes.items():
            if (topic := hand_target(name)) in self._topics:
                yield topic, (ACTION if self._action == "targets" else TARGETS + name, axis_names(name, size))

    def read(self, log: Reader, renames: Mapping[str, str], commands: Commands | None) -> None:
        """Take in the episodes of a log.

        Parameters
        ----------
        log : Reader
            The log, of ticks.
        renames : mapping of str to str
            Our topic names for those that it uses.
        commands : Commands, optional
            Its commands, if they are the actions.

        Raises
        ------
        LogError
            If it cannot be read, or carries no ticks.
        MessageError, JointError
            If its messages are not what they should be.
        """
        with naming(log.path):
            for span in episode_spans(log, self._topics):
                joiner, ticks = self._joiner(), list[Tick]()
                for record in renamed(log, renames, (SESSION_PHASE, *self._topics), span=span):
                    if record.topic == SESSION_PHASE:
                        joiner.clear()
                        self._add(log, ticks, commands)
                        ticks = []
                    else:
                        ticks += joiner.feed(record)
                joiner.finish()
                self._add(log, ticks, commands)

    def _joiner(self) -> TickJoiner:
        return TickJoiner(topics=self._topics, poses=dict.fromkeys(self._hands, _pose))

    def _add(self, log: Reader, ticks: Sequence[Tick], commands: Commands | None) -> None:
        if commands is not None:
            held = commands.at(np.array([tick.stamp_ns for tick in ticks], np.int64))
            self.dropped += int((held < 0).sum())
            ticks, held = [tick for tick, place in zip(ticks, held, strict=True) if place >= 0], held[held >= 0]
        if not ticks:
            return
        joints = JointMap(self._robot.joints)
        columns = {STATE: [np.array([joints.positions(tick.joints) for tick in ticks])]}
        for rank, topic in enumerate(topic for topic in self._topics if topic != SAMPLE_JOINTS):
            feature, names = self._hands[topic]
            columns.setdefault(feature, []).append(np.array([tick.hands[rank][: len(names)] for tick in ticks]))
        if commands is not None:
            columns[ACTION] = [commands.values[held]]
        self.episodes.append({name: np.concatenate(columns[name], axis=1) for name in self.features})
        self._stamps.append((str(log.path), np.array([tick.stamp_ns for tick in ticks], np.int64)))

    def rate(self) -> int:
        """Return the rate of all frames [Hz].

        Raises
        ------
        LogError
            If there are fewer than two in every episode, or they are not at one whole rate.
        """
        longest = max((stamps for _, stamps in self._stamps), key=len, default=np.zeros(0, np.int64))
        if len(longest) < 2:  # a rate is of two
            raise LogError("expected an episode of at least two frames, found none")
        span = int(longest[-1] - longest[0])
        fps = max(round((len(longest) - 1) * _SECOND / span), 1)
        for path, stamps in self._stamps:
            off = np.abs((stamps - stamps[0]) * fps - np.arange(len(stamps)) * _SECOND) > _EVEN_NS * fps
            if off.any():
                at = int(np.flatnonzero(off)[0])
                apart = int(stamps[at] - stamps[at - 1])
                raise LogError(
                    f"{path}: expected ticks at one rate of whole Hz, such as {fps}, found two that are "
                    f"{seconds_text(apart)} s apart; choose one with --tick-rate"
                )
        return fps


def _pose(message: PoseStamped) -> Floats:
    return np.concatenate((message.position, message.orientation))
