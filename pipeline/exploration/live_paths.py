"""Paths of hands from a live pose topic: a publisher of PoseStamped demonstrates the motion, until it is over."""

import logging
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from pipeline.exploration.hand_paths import DemonstratedPaths, from_tracks, poses_sha256
from pipeline.exploration.pose_track import PoseTrack
from recorders.errors import ConfigError, MessageError, MotionError, WireError
from recorders.messages.message_types import PoseStamped
from recorders.messages.record import RecordedMessage
from recorders.nodes.connection_watch import watching_connections
from recorders.text.once import OnceWarner
from recorders.wire.keys.topic_keys import NamespaceKeys, TopicKeys
from recorders.wire.queries import ReceivedOffer
from recorders.wire.receiver import Event, Receiver, ReceiverConfig
from recorders.wire.session import SessionConfig, open_session
from recorders.wire.subscription import LiveMessage

logger = logging.getLogger(__name__)

DEFAULT_IDLE_TIMEOUT_S = 2.0
"""So long a tracker may lose sight of the hand."""

DEFAULT_WAIT_S = 60.0
"""So long somebody may take to start a tracker, and to stand before it."""

_NAME = "demonstration"
_POLL_S = 0.05


@dataclass(frozen=True)
class ListenConfig:
    """Start and end of a subscription to a live pose topic.

    Parameters
    ----------
    duration_s : float
        The demonstration is over when the stamps have come this far [s].
    idle_timeout_s : float
        It is over when no pose has come for this long after the first [s].
    wait_s : float
        How long the first pose may take to come [s].
    keys : TopicKeys
        Keys of the topics, and the namespace.

    Raises
    ------
    ConfigError
        If a time is not above 0.
    """

    duration_s: float = float("inf")
    idle_timeout_s: float = DEFAULT_IDLE_TIMEOUT_S
    wait_s: float = DEFAULT_WAIT_S
    keys: TopicKeys = field(default_factory=NamespaceKeys)

    def __post_init__(self) -> None:
        for name in ("duration_s", "idle_timeout_s", "wait_s"):
            if not getattr(self, name) > 0.0:
                raise ConfigError(f"{name}: expected above 0 s, found {getattr(self, name):g}")


def subscribe_paths(
    topics: Mapping[str, str],
    *,
    renames: Mapping[str, str],
    session: SessionConfig,
    config: ListenConfig,
    stopped: Callable[[], bool] = lambda: False,
) -> DemonstratedPaths:
    """Subscribe to pose topics until the demonstration is over, or somebody stops it.

    Poses may come with an attachment of ours or with none. What is no pose is left out with a line, what is a useless
    one (no number, stamped before the last) is left out and counted. The beginning and the first pose are logged.

    Parameters
    ----------
    topics : mapping of str to str
        Hand by topic.
    renames : mapping of str to str
        Our topic names for those that are published.
    session, config : SessionConfig, ListenConfig
        Where, and for how long.
    stopped : callable
        Whether somebody has stopped it.

    Raises
    ------
    WireError
        If no session can be opened, or no pose comes within `config.wait_s`.
    MotionError
        A hand has fewer than two usable poses.
    """
    # A stamp that leaps farther than the idle timeout is not of this one.
    tracks = {side: PoseTrack(max_gap_s=config.idle_timeout_s) for side in topics.values()}
    types = dict.fromkeys(_published(topics, renames), PoseStamped.TYPE)
    receiving = ReceiverConfig(name=_NAME, keys=config.keys, live=True, topics=types)
    with (
        open_session(session) as opened,
        config.keys.joined(opened),
        Receiver(opened, config=receiving) as receiver,
        watching_connections(opened, session, own=None, namespace=config.keys.namespace),
    ):
        where = ", ".join(session.listen or session.connect)
        logger.info(f"listens to {' and '.join(_published(topics, renames))} at {where}; Ctrl-C ends it")
        _Subscription(topics, renames, tracks, config).run(receiver, stopped)
    if not any(track.seen for track in tracks.values()):
        raise MotionError(f"live: no pose came on {' or '.join(_published(topics, renames))}")
    source = {"kind": "live", "name": "live", "sha256": poses_sha256(tracks)}
    return from_tracks("live", tracks, source={**source, "topics": dict(topics), "renamed": dict(renames)})


class _Subscription:
    """Takes poses in until a demonstration is over."""

    def __init__(
        self,
        topics: Mapping[str, str],
        renames: Mapping[str, str],
        tracks: Mapping[str, PoseTrack],
        config: ListenConfig,
    ) -> None:
        self._topics, self._renames, self._tracks = topics, renames, tracks
        self._config = config
        self._began_s = time.monotonic()
        self._last_s: float | None = None  # when the last pose came
        self._warnings = OnceWarner(logger, limit=len(topics) + len(renames))

    def run(self, receiver: Receiver, stopped: Callable[[], bool]) -> None:
        """Take poses until the demonstration is over."""
        while not (stopped() or self._is_over()):
            self._take_event(receiver, receiver.next_event(_POLL_S))
        receiver.unsubscribe()
        while not self._is_long_enough() and (event := receiver.next_event(0.0)) is not None:
            self._take_event(receiver, event)  # it had arrived before it was over

    def _take_event(self, receiver: Receiver, event: Event | None) -> None:
        if isinstance(event, ReceivedOffer):
            receiver.refuse(event, f"{_NAME} takes what is played on the topics themselves, see replay --play")
        elif isinstance(event, LiveMessage):
            self._take(event.record)

    def _take(self, record: RecordedMessage) -> None:
        side = self._topics.get(self._renames.get(record.topic, record.topic))
        if side is None:
            return
        try:
            used = self._tracks[side].take(record)
        except MessageError as error:
            self._warnings.warn(f"refused on {record.topic}: {error}", kind=record.topic)
            return
        if used:
            if self._last_s is None:
                logger.info(f"the first pose has come, on {record.topic}")
            self._last_s = time.monotonic()

    def _is_over(self) -> bool:
        if self._last_s is None:
            self._check_wait()
            return False
        return self._is_long_enough() or time.monotonic() - self._last_s > self._config.idle_timeout_s

    def _is_long_enough(self) -> bool:
        return max(track.span_s for track in self._tracks.values()) >= self._config.duration_s

    def _check_wait(self) -> None:
        """Raise WireError if the first pose takes too long."""
        if time.monotonic() - self._began_s > self._config.wait_s:
            published, kind = _published(self._topics, self._renames), PoseStamped.TYPE
            keys = [self._config.keys.described(topic, kind) for topic in published]
            raise WireError(
                f"expected a pose on {' or '.join(keys)} within {self._config.wait_s:g} s, found none that "
                "can be used: does anybody publish there, and may this session read it? "
                "See --topic, --namespace and --wait"
            )


def _published(topics: Mapping[str, str], renames: Mapping[str, str]) -> list[str]:
    """Names under which the topics are published."""
    foreign = [name for name, ours in renames.items() if ours in topics]
    return foreign + [name for name in topics if name not in renames.values()]
