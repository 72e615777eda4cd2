"""Settings of an alignment: which ticks, of what; and what is known of the clocks and frames of topics."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from decimal import Decimal, InvalidOperation
from fractions import Fraction
from math import isfinite
from types import MappingProxyType
from typing import Any

from recorders.errors import ConfigError
from recorders.text.quantities import seconds_text
from recorders.text.wording import value_text

DEFAULT_PERIOD_NS = 10**8
"""Ticks are this far apart where nothing else is asked for, and no topic has ticks [ns]."""

DEFAULT_TOLERANCE_NS = 10**8
MAX_TOLERANCE_NS = 5 * 10**9
MAX_LATENCY_NS = 3600 * 10**9

_SECOND = 10**9
_MIN_HZ, _MAX_HZ = Fraction(1, 1000), Fraction(1000)
_NUMBER = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d{1,3})?", re.ASCII)
_SHORTEST = 1e-6
_POSE_SIZE = 7

Transform = tuple[float, float, float, float, float, float, float]
"""Position [m] and orientation (quaternion x, y, z, w of any length but 0) of a frame."""


@dataclass(frozen=True)
class AlignmentConfig:
    """Which ticks are made, and of what.

    Parameters
    ----------
    period_ns : int, optional
        Ticks at the multiples of this since the epoch [ns]; those of a topic if left out.
    ticks_of : str, optional
        Topic, by its name in the log, whose stamps are the ticks. Without it and without a period: the first hand's
        targets, else the first hand as measured, else `DEFAULT_PERIOD_NS`.
    tolerance_ns : int, optional
        A tick is made where each topic has a message at most so long before it, and one at most so long after it [ns];
        `DEFAULT_TOLERANCE_NS` if left out.
    latencies_ns : mapping of str to int
        By topic: how much later its stamps are than what they are of [ns].
    clock : str, optional
        "header" for the stamps of the producers, as if left out, "log" for the times of recording.
    frames : mapping of str to Transform
        By topic: the pose, in the robot's world, of the frame that its messages are in.
    offsets : mapping of str to Transform
        By topic: the pose of the hand in the frame of what is tracked, such as a marker that the hand carries.

    Raises
    ------
    ConfigError
        If a setting is out of range, or two exclude each other.
    """

    period_ns: int | None = None
    ticks_of: str | None = None
    tolerance_ns: int | None = None
    latencies_ns: Mapping[str, int] = field(default_factory=lambda: MappingProxyType({}))
    clock: str | None = None
    frames: Mapping[str, Transform] = field(default_factory=lambda: MappingProxyType({}))
    offsets: Mapping[str, Transform] = field(default_factory=lambda: MappingProxyType({}))

    def __post_init__(self) -> None:
        """Check what the parsing of options does not."""
        if self.period_ns is not None and self.ticks_of is not None:
            raise ConfigError("expected one of --tick-rate and --ticks-of, found both")
        if self.clock not in (None, "header", "log"):
            raise ConfigError(f"--clock: expected header or log, found {value_text(self.clock)}")
        if not 0 <= self.nearness_ns <= MAX_TOLERANCE_NS:
            raise ConfigError(
                f"--tolerance: expected 0 to {seconds_text(MAX_TOLERANCE_NS)} s, found {seconds_text(self.nearness_ns)}"
            )

    @property
    def nearness_ns(self) -> int:
        """The tolerance, that which is asked for or the default [ns]."""
        return DEFAULT_TOLERANCE_NS if self.tolerance_ns is None else self.tolerance_ns

    @property
    def by_log_time(self) -> bool:
        """Whether messages are of the times of their recording."""
        return self.clock == "log"

    @property
    def asks(self) -> bool:
        """Whether anything is asked for, be it the default: a log that carries ticks is then aligned all the same."""
        return self != AlignmentConfig()

    def to_dict(self) -> dict[str, Any]:
        """Return the tolerance and the settings that are not the defaults, for JSON."""
        return {
            **({} if self.period_ns is None else {"period_ns": self.period_ns}),
            **({} if self.ticks_of is None else {"ticks_of": self.ticks_of}),
            "tolerance_ns": self.nearness_ns,
            **({"latencies_ns": dict(sorted(self.latencies_ns.items()))} if self.latencies_ns else {}),
            **({"clock": self.clock} if self.by_log_time else {}),
            **({"frames": _as_json(self.frames)} if self.frames else {}),
            **({"offsets": _as_json(self.offsets)} if self.offsets else {}),
        }


def parse_rate(text: str) -> int:
    """Return the period [ns] of a rate that is written in Hz, to the nearest nanosecond.

    Raises
    ------
    ConfigError
        If it is no number, or out of range.

    Examples
    --------
    >>> parse_rate("30")
    33333333
    """
    rate = _fraction(text)
    if rate is None or not _MIN_HZ <= rate <= _MAX_HZ:
        raise ConfigError(f"--tick-rate: expected a rate from 0.001 to 1000 Hz, found {text[:40]!r}")
    return round(Fraction(_SECOND) / rate)


def parse_signed_seconds(text: str, what: str, most_ns: int) -> int:
    """Return a time that is written in seconds, with a sign or without, to the nearest nanosecond [ns].

    Raises
    ------
    ConfigError
        If it is no number, or beyond `most_ns` on either side of 0.
    """
    seconds = _fraction(text)
    if seconds is None or abs(seconds * _SECOND) > most_ns:
        raise ConfigError(
            f"{what}: expected seconds within {seconds_text(most_ns)} of 0, such as 0.02, found {text[:40]!r}"
        )
    return round(seconds * _SECOND)


def parse_tolerance(text: str) -> int:
    """Return a tolerance [ns] that is written in seconds; raises ConfigError if it is no number or out of range."""
    return parse_signed_seconds(text, "--tolerance", MAX_TOLERANCE_NS)


def parse_latencies(pairs: Sequence[str]) -> dict[str, int]:
    """Return latencies [ns] by topic, of texts TOPIC=SECONDS; raises ConfigError if one is no such pair."""
    return {
        topic: parse_signed_seconds(text, f"--latency {topic}", MAX_LATENCY_NS)
        for topic, text in _split(pairs, "--latency", "TOPIC=SECONDS")
    }


def parse_transforms(pairs: Sequence[str], option: str) -> dict[str, Transform]:
    """Return poses by topic, of texts TOPIC=x,y,z,qx,qy,qz,qw; raises ConfigError if one is no such pair."""
    expected = "TOPIC=x,y,z,qx,qy,qz,qw"
    return {topic: _pose(f"{option} {topic}", text) for topic, text in _split(pairs, option, expected)}


def _as_json(transforms: Mapping[str, Transform]) -> dict[str, list[float]]:
    return {topic: list(pose) for topic, pose in sorted(transforms.items())}


def _pose(what: str, text: str) -> Transform:
    cells = [cell.strip() for cell in text.split(",")]
    numbers = [float(cell) for cell in cells if _NUMBER.fullmatch(cell)]
    if len(numbers) != _POSE_SIZE or len(cells) != _POSE_SIZE or not all(map(isfinite, numbers)):
        raise ConfigError(f"{what}: expected seven numbers x,y,z,qx,qy,qz,qw, found {text[:80]!r}")
    x, y, z, qx, qy, qz, qw = numbers
    if max(map(abs, (qx, qy, qz, qw))) < _SHORTEST:
        raise ConfigError(f"{what}: expected a quaternion with a length, found {text[:80]!r}")
    return x, y, z, qx, qy, qz, qw


def _split(pairs: Sequence[str], option: str, expected: str) -> list[tuple[str, str]]:
    found: dict[str, str] = {}
    for pair in pairs:
        topic, equals, text = pair.partition("=")
        if not (topic and equals and text) or topic in found:
            raise ConfigError(f"{option}: expected {expected}, each topic once, found {pair[:80]!r}")
        found[topic] = text
    return list(found.items())


def _fraction(text: str) -> Fraction | None:
    """Return a number as it is written, to the last digit; None if it is none."""
    if not _NUMBER.fullmatch(text.strip()):
        return None
    try:
        return Fraction(Decimal(text.strip()))
    except (InvalidOperation, ValueError):
        return None
