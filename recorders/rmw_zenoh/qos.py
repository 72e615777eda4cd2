"""Quality of service of an endpoint: as rmw_zenoh writes it into its tokens, and as rosbag2 writes it into a bag."""

from dataclasses import dataclass
from enum import IntEnum
from typing import Any, Self

from recorders.errors import WireError


class Reliability(IntEnum):
    """ROS 2's reliability policy, by its numbers in `rmw/types.h`."""

    SYSTEM_DEFAULT = 0
    RELIABLE = 1
    BEST_EFFORT = 2
    UNKNOWN = 3
    BEST_AVAILABLE = 4


class Durability(IntEnum):
    """ROS 2's durability policy."""

    SYSTEM_DEFAULT = 0
    TRANSIENT_LOCAL = 1
    VOLATILE = 2
    UNKNOWN = 3
    BEST_AVAILABLE = 4


class History(IntEnum):
    """ROS 2's history policy."""

    SYSTEM_DEFAULT = 0
    KEEP_LAST = 1
    KEEP_ALL = 2
    UNKNOWN = 3


class Liveliness(IntEnum):
    """ROS 2's liveliness policy."""

    SYSTEM_DEFAULT = 0
    AUTOMATIC = 1
    MANUAL_BY_NODE = 2
    MANUAL_BY_TOPIC = 3
    UNKNOWN = 4
    BEST_AVAILABLE = 5


_INFINITE = (9223372036, 854775807)  # seconds and nanoseconds, as `RMW_DURATION_INFINITE`
_MAX_NUMBER = 2**64 - 1


@dataclass(frozen=True)
class Qos:
    """Quality of service of a publisher or a subscription; the default is rclcpp's.

    Parameters
    ----------
    reliability, durability, history, liveliness : IntEnum
        The policies.
    depth : int
        How many messages `KEEP_LAST` keeps.
    deadline, lifespan, lease : tuple of (int, int)
        Times [s, ns].
    """

    reliability: Reliability = Reliability.RELIABLE
    durability: Durability = Durability.VOLATILE
    history: History = History.KEEP_LAST
    depth: int = 10
    deadline: tuple[int, int] = _INFINITE
    lifespan: tuple[int, int] = _INFINITE
    liveliness: Liveliness = Liveliness.AUTOMATIC
    lease: tuple[int, int] = _INFINITE

    @property
    def is_latched(self) -> bool:
        """Whether a late joiner gets what was published before."""
        return self.durability is Durability.TRANSIENT_LOCAL

    def to_token(self) -> str:
        """Return the last part of a liveliness token, without what equals rmw_zenoh's defaults, as it writes it."""
        usual = Qos()

        def text(name: str) -> str:
            value = getattr(self, name)
            return "" if value == getattr(usual, name) else f"{value:d}"

        return (
            f"{text('reliability')}:{text('durability')}:{text('history')},{self.depth}:{_pair(self.deadline)}:"
            f"{_pair(self.lifespan)}:{text('liveliness')},{_pair(self.lease)}"
        )

    @classmethod
    def from_token(cls, text: str) -> Self:
        """Read the last part of a liveliness token; what is left out is rmw_zenoh's default, of depth 42.

        Raises
        ------
        WireError
            If it is none.
        """
        parts = [part.split(",") for part in text.split(":")]
        if [len(part) for part in parts] != [1, 1, 2, 2, 2, 3]:
            raise WireError(f"quality of service: expected six parts such as ::,42:,:,:,,, found {text[:100]!r}")
        [[reliability], [durability], [history, depth], deadline, lifespan, [liveliness, *lease]] = parts
        try:
            return cls(
                Reliability(_number(reliability, Reliability.RELIABLE)),
                Durability(_number(durability, Durability.VOLATILE)),
                History(_number(history, History.KEEP_LAST)),
                _number(depth, 42),
                _duration(deadline),
                _duration(lifespan),
                Liveliness(_number(liveliness, Liveliness.AUTOMATIC)),
                _duration(lease),
            )
        except ValueError as error:
            raise WireError(f"quality of service: expected policies of ROS 2, found {text[:100]!r}") from error

    def to_rosbag2(self) -> dict[str, Any]:
        """Return the profile as rosbag2 writes it since Humble: an entry of the list under `offered_qos_profiles`."""
        return {
            "history": int(self.history),
            "depth": self.depth,
            "reliability": int(self.reliability),
            "durability": int(self.durability),
            "deadline": _time(self.deadline),
            "lifespan": _time(self.lifespan),
            "liveliness": int(self.liveliness),
            "liveliness_lease_duration": _time(self.lease),
            "avoid_ros_namespace_conventions": False,
        }


LATCHED = Qos(durability=Durability.TRANSIENT_LOCAL, depth=1)
"""Of a topic whose last message late joiners get, such as /robot_description."""


def _pair(time: tuple[int, int]) -> str:
    seconds, nanoseconds = ("" if part == usual else str(part) for part, usual in zip(time, _INFINITE, strict=True))
    return f"{seconds},{nanoseconds}"


def _time(time: tuple[int, int]) -> dict[str, int]:
    return {"sec": time[0], "nsec": time[1]}


def _number(text: str, default: int) -> int:
    if not text:
        return int(default)
    if not (text.isascii() and text.isdigit()) or len(text) > 20 or int(text) > _MAX_NUMBER:
        raise ValueError(f"expected a number, found {text[:40]!r}")
    return int(text)


def _duration(parts: list[str]) -> tuple[int, int]:
    return _number(parts[0], _INFINITE[0]), _number(parts[1], _INFINITE[1])
