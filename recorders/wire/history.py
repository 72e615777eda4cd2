"""Transient-local samples (of ROS 2's latched topics): publishers that keep them, and delivery to late joiners."""

import logging
import threading
from collections import OrderedDict
from collections.abc import Callable, Iterable
from contextlib import AbstractContextManager, ExitStack, suppress
from types import TracebackType
from typing import Any, Self, TypeAlias

import zenoh
from zenoh.ext import (
    AdvancedPublisher,
    CacheConfig,
    HistoryConfig,
    MissDetectionConfig,
    declare_advanced_publisher,
    declare_advanced_subscriber,
)

from recorders.errors import MessageError
from recorders.rmw_zenoh.attachment import unpack
from recorders.text.once import OnceWarner
from recorders.wire.session import watching_tokens

logger = logging.getLogger(__name__)

_Source: TypeAlias = tuple[str, ...]  # session and publisher; key, session and publisher of one that stamps
_Number: TypeAlias = int  # of a sample there, or its time in the format of NTP

_STAMPING = "/@adv/pub/"  # in the token of a publisher that keeps samples, before its session
_MAX_SOURCES = 1000  # anyone may publish: from later ones nothing is taken but what arrives as it is published
_MAX_BEYOND = 10_000  # as many of those are counted
_MAX_TAKEN = 10_000  # cached samples; of no publisher more are asked for
_ALL = "all topics"
_TOO_MANY = f"one of more than {_MAX_SOURCES} latched publishers: of it only what arrives as it is published is taken"
_TOO_LATE = "published while its earlier messages were asked for, of which at least one is not taken"


def publishing_latched(
    session: zenoh.Session, key: str, *, depth: int = 1, **options: Any
) -> AbstractContextManager[AdvancedPublisher]:
    """Return a publisher whose last samples late joiners get.

    Parameters
    ----------
    session : zenoh.Session
        An open session.
    key : str
        Where to publish.
    depth : int
        How many samples are kept.
    options
        As `zenoh.ext.declare_advanced_publisher` takes them.
    """
    return declare_advanced_publisher(
        session,
        key,
        cache=CacheConfig(max_samples=depth),
        publisher_detection=True,  # by which a subscriber that was there first knows to ask for the history
        # Numbers the samples, which the cache needs; the other way is timestamps, and a client has none by default.
        sample_miss_detection=MissDetectionConfig(heartbeat=None, sporadic_heartbeat=None),
        **options,
    )


class HistorySubscriber:
    """Queries the last samples published on some keys before this came, beside a subscriber of all keys.

    Only publishers with a cache keep anything. They number their samples, or stamp them, as those of rmw_zenoh do, and
    declare that in a token of theirs: anybody else's may be stamped on the way. Of each, all is taken that it keeps,
    until the subscriber has received a sample of its: what is older comes too late then, and is refused. The
    subscriber's own samples all pass, but for those that were taken before. Publishers of one session that stamp are
    distinguished by what rmw_zenoh attaches.

    Parameters
    ----------
    session : zenoh.Session
        An open session.
    keys : iterable of str
        Where to ask; wildcards are expanded.
    hand_over : callable
        Takes the samples, those of the subscriber too, on threads of Zenoh's.
    refuse : callable, optional
        Takes topic and reason of what is not taken: of each cached sample that comes too late, and of each publisher
        beyond those that can be known. If it is left out, each reason is reported once.
    """

    def __init__(
        self,
        session: zenoh.Session,
        keys: Iterable[str],
        hand_over: Callable[[zenoh.Sample], None],
        refuse: Callable[[str, str], None] | None = None,
    ) -> None:
        self._session = session
        self._keys = frozenset(keys)
        self._patterns = [zenoh.KeyExpr(key) for key in sorted(self._keys) if "*" in key]
        self._hand_over = hand_over
        self._lock = threading.Lock()
        self._stamping: set[tuple[str, str]] = set()  # sessions that stamp: with the key
        self._first: dict[_Source, _Number] = {}  # the lowest number that the subscriber received
        self._beyond: set[_Source] = set()  # beyond those, and counted
        self._taken: OrderedDict[tuple[_Source, _Number], None] = OrderedDict()  # and not received yet by it
        warnings = OnceWarner(logger, limit=2)
        self._refuse = refuse or (lambda topic, reason: warnings.warn(f"refused a message: {reason}"))
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        history = HistoryConfig(detect_late_publishers=True, max_samples=_MAX_TAKEN)
        with ExitStack() as stack:
            for key in sorted(self._keys):
                tokens = watching_tokens(self._session, f"{key}{_STAMPING}*/uhlc/**", self._on_token, history=True)
                stack.enter_context(tokens)  # first: what is cached comes after them
                subscriber = declare_advanced_subscriber(
                    self._session, key, self._on_history, history=history, allowed_origin=zenoh.Locality.REMOTE
                )
                stack.enter_context(subscriber)
            self._stack = stack.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stack.close()

    def deliver(self, sample: zenoh.Sample) -> None:
        """Hand over a sample of the subscriber, unless it was delivered from history already."""
        if not (self._keys and self._is_asked(sample.key_expr) and self._was_taken(sample)):
            self._hand_over(sample)

    def _is_asked(self, key: zenoh.KeyExpr) -> bool:
        return str(key) in self._keys or any(pattern.includes(key) for pattern in self._patterns)

    def _on_token(self, token: str, is_there: bool) -> None:
        key, _, publisher = token.rpartition(_STAMPING)
        source = key, publisher.partition("/")[0]
        with self._lock:
            if not is_there:
                self._stamping.discard(source)
                return
            has_room = source in self._stamping or len(self._stamping) < _MAX_SOURCES
            if has_room:
                self._stamping.add(source)
        if not has_room:
            self._refuse(_ALL, _TOO_MANY)

    def _number(self, sample: zenoh.Sample) -> tuple[_Source, _Number] | None:
        """Return who published a sample and its number there; None if its publisher keeps no samples."""
        info, stamp = sample.source_info, sample.timestamp
        if info is not None:
            return (str(info.source_id.zid), str(info.source_id.eid)), int(info.source_sn)
        if stamp is None or not self._stamping:
            return None
        place = str(sample.key_expr), str(stamp.get_id())
        if place not in self._stamping:
            return None
        return (*place, _publisher_of(sample)), int(str(stamp.get_time_as_ntp64()))

    def _was_taken(self, sample: zenoh.Sample) -> bool:
        number = self._number(sample)
        if number is None:
            return False
        source, place = number
        with self._lock:
            if source in self._first or len(self._first) < _MAX_SOURCES:
                self._first[source] = min(place, self._first.get(source, place))
            if number not in self._taken:
                return False
            del self._taken[number]
            return True

    def _on_history(self, sample: zenoh.Sample) -> None:
        """Take samples from history; new ones come here as well, but those are the other subscriber's."""
        number = self._number(sample)
        if number is None:
            return
        with self._lock:
            reason = self._reason_against(*number)
            if reason is None:
                self._taken[number] = None
                if len(self._taken) > _MAX_TAKEN:
                    self._taken.popitem(last=False)
        if reason is None:
            self._hand_over(sample)
        elif reason:
            self._refuse(_ALL if reason == _TOO_MANY else str(sample.key_expr), reason)

    def _reason_against(self, source: _Source, place: _Number) -> str | None:
        """Return why a sample is not taken from history, empty if it is here already; None if it is taken."""
        if (source, place) in self._taken:
            return ""
        first = self._first.get(source)
        if first is not None:
            return _TOO_LATE if place < first else ""
        if len(self._first) < _MAX_SOURCES:
            return None
        if source in self._beyond or len(self._beyond) >= _MAX_BEYOND:
            return ""
        self._beyond.add(source)  # all of its samples come here, also those that the subscriber takes
        return _TOO_MANY


def _publisher_of(sample: zenoh.Sample) -> str:
    """Return how rmw_zenoh names the publisher of a sample; empty if it is not named."""
    with suppress(MessageError):
        if sample.attachment is not None:
            return unpack(sample.attachment.to_bytes())[0].gid.hex()
    return ""
