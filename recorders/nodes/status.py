"""Status of a long-running node: a liveliness token, a status on request, and metrics."""

import json
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from typing import Any, Self

import zenoh

from recorders.errors import WireError
from recorders.nodes.keys import NodeId, node_key
from recorders.text.wording import value_text
from recorders.threads import periodic_thread

MAX_STATUS = 1 << 16
"""Larger answers are not read [bytes]; those of ours take less than 2 kB."""

_SAMPLES = 4  # rates are taken over so many periods at most
_PERIOD_S = 1.0
_MAX_AGE_S = 0.1  # whoever asks more often gets the same answer: a flood of questions costs a node next to nothing
_MAX_ENTRIES = 200
_MAX_TEXT = 200
_MAX_COUNT = 2**63 - 1


@dataclass(frozen=True)
class NodeSource:
    """Source of a node's status; everything is asked for on threads of its own, and must return at once.

    Parameters
    ----------
    kind, name : str
        As `recorders.nodes.keys` has them.
    state : callable
        What it does at the moment, in a word or two.
    counts : callable
        What it has counted so far; asked for every second.
    latency_us : callable
        Latencies of late by percentile, `p50`, `p90`, `p99` and `max` [us]; None where there are none.
    digests : callable
        Digests that are known without being computed, by name.
    """

    kind: str
    name: str
    state: Callable[[], str]
    counts: Callable[[], Mapping[str, int]]
    latency_us: Callable[[], Mapping[str, float | None]] = dict
    digests: Callable[[], Mapping[str, str]] = dict


@dataclass(frozen=True)
class NodeStatus:
    """The status of a node.

    Attributes
    ----------
    kind, name : str
        What and who it is.
    state : str
        What it does at the moment.
    since_s : float or None
        How long it has been there, by its own monotonic clock [s]; None if it is not stated.
    counts : mapping of str to int
        What it has counted since then, by name.
    rates_hz : mapping of str to float
        How fast each count has grown over the last seconds, by the same clock [Hz].
    latency_us : mapping of str to float or None
        Latencies of late, `p50`, `p90`, `p99` and `max` [us]; None where there are none.
    digests : mapping of str to str
        Digests, by name.
    """

    kind: str
    name: str
    state: str
    since_s: float | None = None
    counts: Mapping[str, int] = field(default_factory=dict)
    rates_hz: Mapping[str, float] = field(default_factory=dict)
    latency_us: Mapping[str, float | None] = field(default_factory=dict)
    digests: Mapping[str, str] = field(default_factory=dict)

    def to_dict(self) -> dict[str, Any]:
        """Return the status as JSON has it."""
        return asdict(self)

    @classmethod
    def from_json(cls, node: NodeId, data: bytes) -> Self:
        """Read a status back, from whoever sent it under the key of a node.

        Raises
        ------
        WireError
            If it is none, or one of another node.
        """
        found = _object(data)
        if set(found) != set(cls.__dataclass_fields__):
            raise WireError(f"expected an object with {', '.join(cls.__dataclass_fields__)}")
        if (found["kind"], found["name"]) != tuple(node):
            raise WireError(f"expected the status of {node}")
        _check(found["state"], _is_text, "state")
        _check(found["since_s"], _is_time, "since_s")
        for name, fits in (
            ("counts", _is_count),
            ("rates_hz", _is_number),
            ("latency_us", _is_number_or_none),
            ("digests", _is_text),
        ):
            _check(found[name], lambda value: isinstance(value, dict) and len(value) <= _MAX_ENTRIES, name)
            for key, value in found[name].items():
                _check(key, _is_text, name)
                _check(value, fits, name)
        return cls(**found)


class NodeMeter:
    """Makes the status of a node out of its source: adds the time and the rates.

    Parameters
    ----------
    source : NodeSource
        The node.
    """

    def __init__(self, source: NodeSource) -> None:
        self._source = source
        self._began_s = time.monotonic()
        self._samples: deque[tuple[float, Mapping[str, int]]] = deque(maxlen=_SAMPLES)
        self._lock = threading.Lock()
        self._last: tuple[float, NodeStatus] | None = None
        self.sample()

    def sample(self) -> None:
        """Note the counts of now, from which later rates are taken."""
        self._samples.append((time.monotonic(), dict(self._source.counts())))

    def status(self) -> NodeStatus:
        """Return the status; the last one, if it is recent."""
        with self._lock:
            now_s = time.monotonic()
            if self._last is None or now_s - self._last[0] > _MAX_AGE_S:
                self._last = now_s, self._measure(now_s)
            return self._last[1]

    def _measure(self, now_s: float) -> NodeStatus:
        source, counts = self._source, dict(self._source.counts())
        then_s, before = self._samples[0]
        passed_s = now_s - then_s
        rates = {
            name: (count - before.get(name, 0)) / passed_s if passed_s > 0.0 else 0.0 for name, count in counts.items()
        }
        return NodeStatus(
            source.kind,
            source.name,
            source.state(),
            now_s - self._began_s,
            counts,
            rates,
            dict(source.latency_us()),
            dict(source.digests()),
        )


@contextmanager
def declared_node(session: zenoh.Session, source: NodeSource, *, namespace: str) -> Iterator[NodeMeter]:
    """Answer whoever asks for a node's status while the block runs, and declare its token, as `node_key` names both.

    Parameters
    ----------
    session : zenoh.Session
        An open session.
    source : NodeSource
        The node.
    namespace : str
        First part of every key.

    Yields
    ------
    NodeMeter
        The answers come from it.
    """
    meter = NodeMeter(source)
    key = node_key(namespace, source.kind, source.name, "status")

    def answer(query: zenoh.Query) -> None:
        with query:
            query.reply(key, json.dumps(meter.status().to_dict()), encoding=zenoh.Encoding.APPLICATION_JSON)

    token = node_key(namespace, source.kind, source.name, "alive")
    with (
        periodic_thread(meter.sample, name="rates", every_s=_PERIOD_S),
        session.declare_queryable(key, answer),
        session.liveliness().declare_token(token),
    ):
        yield meter


def _object(data: bytes) -> dict[str, Any]:
    try:
        found = json.loads(data)
    except (ValueError, RecursionError):
        found = None
    if not isinstance(found, dict):
        raise WireError("expected a JSON object")
    return found


def _check(value: object, fits: Callable[[Any], bool], name: str) -> None:
    if not fits(value):
        raise WireError(f"{name}: found {value_text(value, limit=40)}")


def _is_text(value: Any) -> bool:
    return isinstance(value, str) and len(value) <= _MAX_TEXT


def _is_count(value: Any) -> bool:
    return type(value) is int and 0 <= value <= _MAX_COUNT


def _is_number(value: Any) -> bool:
    return type(value) in (int, float) and abs(value) <= _MAX_COUNT  # which no NaN is


def _is_number_or_none(value: Any) -> bool:
    return value is None or _is_number(value)


def _is_time(value: Any) -> bool:
    return value is None or (_is_number(value) and value >= 0.0)
