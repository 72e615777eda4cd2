"""Transient-local samples (of ROS 2's latched topics): publishers that keep them, and delivery to late joiners."""

import threading
from collections.abc import Callable, Iterable
from contextlib import AbstractContextManager, ExitStack
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

from recorders.wire.session import watching_tokens

_Source: TypeAlias = tuple[str, str]  # session and publisher; key and session of one that stamps
_Number: TypeAlias = int | zenoh.NTP64

_STAMPING = "/@adv/pub/"  # in the token of a publisher that keeps samples, before its session
_MAX_SOURCES = 1000  # anyone may publish: from later ones nothing is taken but what arrives as it is published


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
    declare that in a token of theirs: anybody else's may be stamped on the way. Of each, one cached sample is taken,
    and none if it was received already; the subscriber's own samples all pass, but for the one that was taken before.

    Parameters
    ----------
    session : zenoh.Session
        An open session.
    keys : iterable of str
        Where to ask; wildcards are expanded.
    hand_over : callable
        Takes the samples, those of the subscriber too, on threads of Zenoh's.
    """

    def __init__(self, session: zenoh.Session, keys: Iterable[str], hand_over: Callable[[zenoh.Sample], None]) -> None:
        self._session = session
        self._keys = frozenset(keys)
        self._patterns = [zenoh.KeyExpr(key) for key in sorted(self._keys) if "*" in key]
        self._hand_over = hand_over
        self._lock = threading.Lock()
        self._stamping: set[_Source] = set()  # those that stamp: key and session
        self._sources: set[_Source] = set()
        self._taken: set[tuple[_Source, _Number]] = set()  # and not received yet by the subscriber
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        history = HistoryConfig(detect_late_publishers=True, max_samples=1)
        for key in sorted(self._keys):
            tokens = watching_tokens(self._session, f"{key}{_STAMPING}*/uhlc/**", self._on_token, history=True)
            self._stack.enter_context(tokens)  # first: what is cached comes after them
            subscriber = declare_advanced_subscriber(
                self._session, key, self._on_history, history=history, allowed_origin=zenoh.Locality.REMOTE
            )
            self._stack.enter_context(subscriber)
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
            elif len(self._stamping) < _MAX_SOURCES:
                self._stamping.add(source)

    def _number(self, sample: zenoh.Sample) -> tuple[_Source, _Number] | None:
        """Return who published a sample and its number there; None if its publisher keeps no samples."""
        info, stamp = sample.source_info, sample.timestamp
        if info is not None:
            return (str(info.source_id.zid), str(info.source_id.eid)), int(info.source_sn)
        if stamp is None or not self._stamping:
            return None
        source = str(sample.key_expr), str(stamp.get_id())
        return (source, stamp.get_time_as_ntp64()) if source in self._stamping else None

    def _was_taken(self, sample: zenoh.Sample) -> bool:
        number = self._number(sample)
        if number is None:
            return False
        with self._lock:
            self._note(number[0])
            if number not in self._taken:
                return False
            self._taken.remove(number)
            return True

    def _on_history(self, sample: zenoh.Sample) -> None:
        """Take samples from history; new ones come here as well, but those are the other subscriber's."""
        number = self._number(sample)
        if number is None:
            return
        with self._lock:
            if number[0] in self._sources or not self._note(number[0]):
                return
            self._taken.add(number)
        self._hand_over(sample)

    def _note(self, source: _Source) -> bool:
        """Note that a publisher is known; False if there are too many."""
        if len(self._sources) < _MAX_SOURCES:
            self._sources.add(source)
        return source in self._sources
