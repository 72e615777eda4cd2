"""Quality of service of an endpoint: as rmw_zenoh writes it into its tokens, and as rosbag2 writes it into a bag."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, Self, TypeVar

from recorders.errors import WireError
from recorders.messages.topics import ROBOT_TEXTS, TF_STATIC
from recorders.text.plain_yaml import from_yaml, to_yaml


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


_Policy = TypeVar("_Policy", bound=IntEnum)

MAX_DEPTH = 1000
"""As many messages are kept for late joiners: rclcpp's own histories are of 1 to 1000."""

_INFINITE = (9223372036, 854775807)  # seconds and nanoseconds, as `RMW_DURATION_INFINITE`
_INFINITE_OF_FOXY = ((2147483647, 4294967295), (2147483647, 2147483647))  # of Fast DDS and Connext, in old bags
_MAX_DEPTH_OF_ROSBAG2 = 2**31 - 1  # which reads no bag in which anybody has offered more
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

    @property
    def cache_depth(self) -> int:
        """How many messages a publisher that is latched keeps for late joiners, whatever depth a bag states."""
        return MAX_DEPTH if self.history is History.KEEP_ALL else min(max(1, self.depth), MAX_DEPTH)

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
        """Return the profile as rosbag2 writes it in bags of version 4 to 8, and in every MCAP file that it reads."""
        return {
            "history": int(self.history),
            "depth": min(self.depth, _MAX_DEPTH_OF_ROSBAG2),
            "reliability": int(self.reliability),
            "durability": int(self.durability),
            "deadline": _time(self.deadline),
            "lifespan": _time(self.lifespan),
            "liveliness": int(self.liveliness),
            "liveliness_lease_duration": _time(self.lease),
            "avoid_ros_namespace_conventions": False,
        }

    @classmethod
    def from_rosbag2(cls, profile: Any) -> Self:
        """Read a profile of any version of rosbag2: policies by number, and since version 9 by name.

        Raises
        ------
        WireError
            If it is none.
        """
        try:
            return cls(
                _policy(Reliability, profile["reliability"]),
                _policy(Durability, profile["durability"]),
                _policy(History, profile["history"]),
                _count(profile["depth"]),
                _rosbag2_time(profile["deadline"]),
                _rosbag2_time(profile["lifespan"]),
                _policy(Liveliness, profile["liveliness"]),
                _rosbag2_time(profile["liveliness_lease_duration"]),
            )
        except (KeyError, TypeError, ValueError) as error:
            raise WireError(f"quality of service: expected a profile of rosbag2, found {str(profile)[:100]}") from error


LATCHED = Qos(durability=Durability.TRANSIENT_LOCAL, depth=1)
"""Of a topic whose last message late joiners get, such as /robot_description."""

_LATCHED_TOPICS = frozenset((*ROBOT_TEXTS.values(), TF_STATIC))


def qos_text(profiles: Iterable[Qos]) -> str:
    """Return the profiles that the publishers of a topic offer as rosbag2 has them: a list, in YAML."""
    return to_yaml([profile.to_rosbag2() for profile in profiles]).rstrip()


def read_qos_text(text: str) -> list[Qos]:
    """Return the profiles of such a text; none of an empty one, as bags without a graph have it.

    Raises
    ------
    WireError
        If it is none.
    """
    if not text:
        return []
    try:
        found = from_yaml(text.encode())
    except ValueError as error:
        raise WireError(f"quality of service: {error}: {text[:100]!r}") from error
    if not isinstance(found, list):
        raise WireError(f"quality of service: expected a list of profiles, found {text[:100]!r}")
    return [Qos.from_rosbag2(profile) for profile in found]


def strictest(profiles: Sequence[Qos]) -> Qos:
    """Return what one publisher offers in place of several, so that every subscription matches that matched one.

    Its depth is that of all together: each latched message of theirs is still there for late joiners.
    """
    if not profiles:
        return Qos()
    only_best_effort = all(each.reliability is Reliability.BEST_EFFORT for each in profiles)
    keeps_all = any(each.history is History.KEEP_ALL for each in profiles)
    manual = any(each.liveliness is Liveliness.MANUAL_BY_TOPIC for each in profiles)
    return Qos(
        Reliability.BEST_EFFORT if only_best_effort else Reliability.RELIABLE,
        Durability.TRANSIENT_LOCAL if any(each.is_latched for each in profiles) else Durability.VOLATILE,
        History.KEEP_ALL if keeps_all else History.KEEP_LAST,
        min(sum(each.depth for each in profiles), MAX_DEPTH),
        min(each.deadline for each in profiles),
        max(each.lifespan for each in profiles),
        Liveliness.MANUAL_BY_TOPIC if manual else Liveliness.AUTOMATIC,
        min(each.lease for each in profiles),
    )


def matching(offered: Sequence[Qos]) -> Qos:
    """Return what a subscription requests that matches every publisher of a topic, as rosbag2's recorder does."""
    reliable = all(each.reliability is not Reliability.BEST_EFFORT for each in offered)
    latched = bool(offered) and all(each.is_latched for each in offered)
    return Qos(
        Reliability.RELIABLE if reliable else Reliability.BEST_EFFORT,
        Durability.TRANSIENT_LOCAL if latched else Durability.VOLATILE,
    )


def _policy(kind: type[_Policy], value: Any) -> _Policy:
    if isinstance(value, str):
        return kind[value.upper()]
    return kind(_count(value))


def _count(value: Any) -> int:
    if type(value) is not int or not 0 <= value <= _MAX_NUMBER:
        raise ValueError(f"expected a number, found {str(value)[:40]}")
    return value


def _rosbag2_time(value: Any) -> tuple[int, int]:
    time = _count(value["sec"]), _count(value["nsec"])
    return _INFINITE if time in _INFINITE_OF_FOXY else time


def usual_qos(topic: str) -> Qos:
    """Return the quality of service with which ROS 2's own nodes offer a topic, and ours."""
    return LATCHED if topic in _LATCHED_TOPICS else Qos()


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
