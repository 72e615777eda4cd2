"""Whom a stream is sent to over Zenoh, and how."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from recorders.errors import ConfigError
from recorders.rmw_zenoh.qos import Qos
from recorders.text.wording import names_text
from recorders.wire.keys.namespace import check_name
from recorders.wire.keys.ros_keys import RosKeys
from recorders.wire.keys.topic_keys import NamespaceKeys, TopicKeys

_LONGEST_WAIT_S = 86_400.0


@dataclass(frozen=True)
class SenderConfig:
    """Whom to feed, and how.

    Parameters
    ----------
    consumers : tuple of str
        Names of the consumers that are awaited; the window is the slowest one's. A served controller may be one of
        them: it is awaited, acknowledges nothing, and its result is its status. Without any, whoever listens may lose
        messages.
    keys : TopicKeys
        Keys of the topics, and the namespace.
    window : int
        How many messages may be under way unacknowledged; beside less than half of it, one more batch may.
    batch_size : int
        How many messages travel in one payload; with 1, each travels on the key of its own topic.
    wait_s : float
        How long a consumer may take to appear [s].
    patience_s : float
        How long a consumer may leave every question unanswered, or receive nothing of what is sent [s].
    key_file : Path, optional
        File with the key that this shares with the consumers; if left out, the user's own.
    qos : mapping of str to Qos
        What is offered on topics of a ROS domain; of others, what their nodes offer.
    wait_for : mapping of str to int
        How many subscriptions of topics of a ROS domain are awaited, for as long as a consumer is.

    Raises
    ------
    ConfigError, WireError
        If a number is out of range, or a name cannot be part of a key.
    """

    consumers: tuple[str, ...] = ("learner",)
    keys: TopicKeys = field(default_factory=NamespaceKeys)
    window: int = 1024
    batch_size: int = 64
    wait_s: float = 10.0
    patience_s: float = 30.0
    key_file: Path | None = None
    qos: Mapping[str, Qos] = field(default_factory=dict)
    wait_for: Mapping[str, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Check names and ranges."""
        for name in self.consumers:
            check_name(name)
        if len(set(self.consumers)) != len(self.consumers):
            raise ConfigError(f"expected each consumer once, found {names_text(self.consumers)}")
        if self.consumers and self.keys.renames:
            raise ConfigError(
                f"--remap: expected none where {names_text(self.consumers)} is awaited, as a stream states its topics "
                "by name; rename at the other end, or with --map"
            )
        if not 1 <= self.batch_size <= self.window:
            raise ConfigError(
                f"expected 1 <= batch size <= window, found batch size {self.batch_size} and window {self.window}"
            )
        if self.wait_for and not isinstance(self.keys, RosKeys):
            raise ConfigError("--wait-for: expected --ros beside it: subscriptions are counted in a ROS domain")
        for topic, number in self.wait_for.items():
            if number < 1:
                raise ConfigError(f"--wait-for {topic}: expected 1 subscription or more, found {number}")
        for name, seconds in (("wait", self.wait_s), ("patience", self.patience_s)):
            if not 0.0 <= seconds <= _LONGEST_WAIT_S:
                raise ConfigError(f"{name}: expected 0 to {_LONGEST_WAIT_S:g} s, found {seconds:g}")

    @property
    def namespace(self) -> str:
        """First part of the control keys."""
        return self.keys.namespace
