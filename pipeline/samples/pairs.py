"""From ticks to samples: those of a log, joined once."""

from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from pipeline.arrays import Floats
from pipeline.robot.config import RobotConfig
from pipeline.robot.range_check import range_check
from pipeline.robot.recorded import recorded_robot, require_recorded_robot
from pipeline.samples.pairing import COMMANDED, PairingRule, find_pairing
from recorders.containers.opening import open_log
from recorders.containers.reader import Opened, Reader
from recorders.errors import LogError
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import SESSION_PHASE
from recorders.ticks.joiner import join_ticks
from replay.sources.episodes import Span, alignment_of, episode_spans
from replay.sources.scheduled import naming, renamed
from replay.sources.stream_digest import digest_link

_NO_RENAMES: Mapping[str, str] = MappingProxyType({})


@dataclass(frozen=True, eq=False)
class Presentation:
    """Samples of one presentation, joined once and used for every repetition.

    Attributes
    ----------
    stamps_ns : list of int, length T
        Stamps of the inputs [ns].
    end_ns : int
        Stamp of the last tick [ns].
    u : ndarray, shape (T, inputs)
        Hands: positions [m], and turns [rad] where the pose is controlled; targets, or as measured.
    d : ndarray, shape (T, inputs + joints)
        What they teach: hands alike, joints [rad or m].
    pending : ndarray, shape (inputs,) or (0,)
        The input of the last tick, if it waits for a teaching signal.
    links : list of bytes
        What each tick adds to the stream digest.
    """

    stamps_ns: list[int]
    end_ns: int
    u: Floats
    d: Floats
    pending: Floats
    links: list[bytes]

    @classmethod
    def of(cls, messages: Iterable[RecordedMessage], robot: RobotConfig, rule: PairingRule) -> "Presentation":
        """Join the messages of one presentation to ticks, and these to steps, as `LearningRun.feed` does.

        Raises
        ------
        MessageError, JointError
            If a message is not what it should be, or cannot be of the robot.
        """
        check = range_check(robot)
        ticks = list(join_ticks(messages, check, rule.topics(robot.hand_names), check.poses))
        pairs = rule.pairs(robot)
        inputs = robot.input_centre.size
        u, d = np.empty((len(ticks), inputs)), np.empty((len(ticks), inputs + len(robot.joints)))
        stamps_ns: list[int] = []
        for tick in ticks:
            if pairs.fill(tick, u[len(stamps_ns)], d[len(stamps_ns)]):
                stamps_ns.append(pairs.stamp_ns)
        return cls(
            stamps_ns=stamps_ns,
            end_ns=ticks[-1].stamp_ns if ticks else 0,
            u=u[: len(stamps_ns)],
            d=d[: len(stamps_ns)],
            pending=pairs.pending,
            links=[digest_link(tick.records) for tick in ticks],
        )


@dataclass(frozen=True, eq=False)
class Samples:
    """The samples of one episode.

    Attributes
    ----------
    targets : ndarray, shape (T, inputs)
        u(k): hands asked for, or reached: positions [m], and turns [rad] where the pose is controlled.
    joints : ndarray, shape (T, n)
        q(k): joints at the end of the hold of u(k), or at its instant [rad or m].
    robot : RobotConfig
        The robot that was recorded.
    """

    targets: Floats
    joints: Floats
    robot: RobotConfig


def read_samples(
    path: Opened,
    *,
    robot: RobotConfig | None = None,
    pairs: str = COMMANDED,
    renames: Mapping[str, str] = _NO_RENAMES,
) -> Samples:
    """Read the samples of a log; of a recorded session, those of its first presentation.

    Parameters
    ----------
    path : Path, Parts or Reader
        A log, or a session in parts.
    robot : RobotConfig, optional
        The robot, for a log that carries none.
    pairs : str
        Name of the pairing rule.
    renames : mapping of str to str
        Our topic names for those that the log uses.

    Raises
    ------
    ConfigError
        If there is no such pairing rule.
    LogError
        If the log cannot be read, holds fewer ticks than make a sample, or carries no robot and none is given.
    MessageError, JointError, RobotError
        If its messages or its robot are not what they should be.
    """
    rule = find_pairing(pairs)
    reader = open_log(path)
    robot = recorded_robot(reader) or robot or require_recorded_robot(reader)
    topics = rule.topics(robot.hand_names)
    with naming(reader.path):
        presented = [
            Presentation.of(_first_presentation(reader, renames, topics, span), robot, rule)
            for span in episode_spans(reader, topics)
        ]
    u, d = (np.concatenate(parts) for parts in zip(*((one.u, one.d) for one in presented), strict=True))
    if not len(u):
        raise LogError(f"{reader.path}: expected at least two complete ticks, found fewer; record with explore")
    return Samples(u, d[:, u.shape[1] :].copy(), robot)


def _first_presentation(
    reader: Reader, renames: Mapping[str, str], topics: Collection[str], span: Span
) -> Iterator[RecordedMessage]:
    """Yield the learner's messages of an episode, and of a session those between its first two phase markers.

    In a log of aligned ticks every presentation is an episode of its own.
    """
    if alignment_of(reader) is not None:
        yield from renamed(reader, renames, topics, span=span)
        return
    under_way = not reader.counts.get(SESSION_PHASE)
    for message in renamed(reader, renames, (SESSION_PHASE, *topics), span=span):
        if message.topic == SESSION_PHASE:
            if under_way:
                return
            under_way = True
        elif under_way:
            yield message
