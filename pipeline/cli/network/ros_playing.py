"""Options of replay that mean something in a ROS domain: whom it waits for there, and the time that it publishes."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated

import typer

from pipeline.cli.project_settings import of_settings
from recorders.errors import ConfigError
from recorders.text.wording import names_text

if TYPE_CHECKING:
    from recorders.mcap_format.channels import DeclaredChannel
    from recorders.wire.keys.ros_keys import RosKeys
    from replay.transports.sender_config import SenderConfig
    from replay.transports.transport import Source

_NS_PER_S = 10**9
_MAX_RATE_HZ = 10_000.0


@dataclass(frozen=True)
class RosPlayOptions:
    """Subscriptions that are waited for, and the rate of `/clock`."""

    wait_for: Annotated[
        list[str] | None,
        typer.Option(
            help="With --ros and --play: begin when a topic has so many subscriptions; within --wait. May be repeated.",
            metavar="TOPIC=N",
        ),
    ] = None
    clock_rate: Annotated[
        float | None,
        typer.Option(
            help="With --play and --rate: publish the log time on /clock, so often in each second of it.",
            metavar="HZ",
        ),
    ] = None

    def subscriptions(self) -> dict[str, int]:
        """Return how many subscriptions are awaited, by topic; raises ConfigError if that is no number."""
        found = {}
        for text in self.wait_for or ():
            topic, separator, number = text.rpartition("=")
            if not separator or not topic or not (number.isascii() and number.isdigit() and len(number) <= 4):
                raise ConfigError(f"--wait-for: expected TOPIC=N, such as /joint_states=1, found {text[:100]!r}")
            found[topic] = int(number)
        return found

    def clock_period_ns(self, *, plays: bool, paced: bool) -> int | None:
        """Return the period of `/clock` [ns]; None if it is not published.

        Raises
        ------
        ConfigError
            If the rate is out of range, or nothing is played at a pace.
        """
        if self.clock_rate is None:
            return None
        if not (plays and paced):
            raise ConfigError("--clock-rate: expected --play and --rate beside it: time passes with what is played")
        if not 0.001 <= self.clock_rate <= _MAX_RATE_HZ:
            raise ConfigError(f"--clock-rate: expected 0.001 to {_MAX_RATE_HZ:g} Hz, found {self.clock_rate:g}")
        return round(_NS_PER_S / self.clock_rate)

    def applied(self, sender: "SenderConfig", source: "Source") -> tuple["SenderConfig", "tuple[DeclaredChannel, ...]"]:
        """Return a sender's settings with what is awaited and offered in a domain, and the channels that it declares.

        Raises
        ------
        ConfigError, LogError
            If an option is malformed, or what is played cannot be offered in a domain.
        """
        from recorders.wire.keys.ros_keys import RosKeys
        from replay.sources.playback import Playback

        if not isinstance(source, Playback):
            if self.wait_for and not of_settings("wait-for"):
                raise ConfigError("--wait-for: expected --play beside it: a schedule is sent to those whom it awaits")
            return sender, ()
        sender = replace(sender, wait_for=self.subscriptions())
        if isinstance(sender.keys, RosKeys):
            _note_hashes(sender.keys, source.channels)
            sender = replace(sender, qos=source.qos)
        return sender, source.channels


def _note_hashes(keys: "RosKeys", channels: Iterable["DeclaredChannel"]) -> None:
    """Have the keys of a ROS domain take over the hashes of types that the recordings define.

    Raises
    ------
    ConfigError
        If the hash of a type is not known, which is a part of the key, or there are two of a topic's.
    """
    from recorders.containers.definitions import definition_hash

    if keys.humble:
        return
    unknown = []
    for channel in channels:
        if not (found := definition_hash(channel)):
            unknown.append(channel.topic)
        elif keys.hashes.setdefault((channel.topic, channel.type), found) != found:
            raise ConfigError(
                f"--ros: {channel.topic}: expected one definition of {channel.type}, found two, whose messages no node "
                "would get all; choose the other topics with --topic"
            )
    if unknown:
        raise ConfigError(
            f"--ros: {names_text(sorted(unknown))}: expected a type with its definition, found none in the recording; "
            "choose the other topics with --topic"
        )
