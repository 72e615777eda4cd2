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

_Source: TypeAlias = tuple[str, int]  # session and publisher
_Number: TypeAlias = int | zenoh.NTP64

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


def subscribing_latched(session: zenoh.Session, key: str, take: Any) -> AbstractContextManager[Any]:
    """Return a subscriber that gets the last sample of each publisher that keeps some, and all later ones.

    Parameters
    ----------
    session : zenoh.Session
        An open session.
    key : str
        Where to subscribe.
    take
        A function or handler of Zenoh's.
    """
    history = HistoryConfig(detect_late_publishers=True, max_samples=1)
    return declare_advanced_subscriber(session, key, take, history=history)


class HistorySubscriber:
    """Queries the last samples published on some keys before this came, beside a subscriber of all keys.

    Only publishers with a cache keep anything, and they number their samples. Of each, one cached sample is taken, and
    none if it was received already; the subscriber's own samples all pass, but for the one that was taken before.

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
        self._sources: set[_Source] = set()
        self._taken: set[tuple[_Source, _Number]] = set()  # and not received yet by the subscriber
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        history = HistoryConfig(detect_late_publishers=True, max_samples=1)
        for key in sorted(self._keys):
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

    def _was_taken(self, sample: zenoh.Sample) -> bool:
        number = _number(sample)
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
        number = _number(sample)
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


def _number(sample: zenoh.Sample) -> tuple[_Source, _Number] | None:
    """Return who published a sample and its number there; None if its publisher keeps no count, nor stamps it.

    Latched publishers of rmw_zenoh stamp theirs, ours count.
    """
    info, stamp = sample.source_info, sample.timestamp
    if info is not None:
        return (str(info.source_id.zid), int(info.source_id.eid)), int(info.source_sn)
    if stamp is not None:
        return (f"{stamp.get_id()} {sample.key_expr}", 0), stamp.get_time_as_ntp64()
    return None
