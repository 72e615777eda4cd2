"""The options `--ros`, `--remap` and `--use-sim-time`: topics of a ROS domain, not of a namespace, and its time."""

import os
import re
from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated

import typer

from pipeline.cli.project_settings import SETTINGS_FILE, of_settings
from recorders.errors import ConfigError
from recorders.rmw_zenoh.names import MAX_DOMAIN

if TYPE_CHECKING:
    from recorders.wire.keys.topic_keys import TopicKeys

_OPTION = "--ros"
_VARIABLE = "ROS_DOMAIN_ID"

_NONE = "none"


def _domain(text: str) -> int | None:
    """Return the domain that an option states; None where it states that there is none, whatever a file sets."""
    if text == _NONE:
        return None
    if not _is_domain(text):
        raise typer.BadParameter(f"expected 0 to {MAX_DOMAIN}, or {_NONE}, found {text[:40]!r}")
    return int(text)


def _is_domain(text: str) -> bool:
    return text.isascii() and text.isdigit() and len(text) <= len(str(MAX_DOMAIN)) and int(text) <= MAX_DOMAIN


RosDomain = Annotated[
    int | None,
    typer.Option(
        _OPTION,
        help=f"Topics of a ROS 2 domain, by rmw_zenoh, in place of a namespace's; without a number, {_VARIABLE} or 0. "
        f"{_OPTION}={_NONE}: of a namespace, whatever {SETTINGS_FILE} sets.",
        parser=_domain,
        metavar="DOMAIN",
    ),
]


Remap = Annotated[
    list[str] | None,
    typer.Option(
        help="With --ros: FROM:=TO, another name for a topic, or for the node (__node, __ns); may be repeated.",
        metavar="RULE",
    ),
]

Humble = Annotated[
    bool,
    typer.Option(
        "--humble", help="With --ros: publish as ROS 2 Humble does, without hashes of types, for nodes of it alone."
    ),
]

UseSimTime = Annotated[
    bool, typer.Option("--use-sim-time", help="Take the time from /clock, and not from the clock on the wall.")
]

_NO_NAME = re.compile(r"[^A-Za-z0-9]+")  # with every `_` beside it: two in a row are none of ROS 2's either


def topic_keys(
    name: str, namespace: str, ros: int | None, remap: list[str] | None, *, humble: bool = False
) -> "TopicKeys":
    """Return the keys of topics that a verb was asked for.

    Parameters
    ----------
    name : str
        Name of the node, which a ROS domain sees; what cannot be in one there becomes `_`.
    namespace : str
        First part of the keys, or of the control keys alone.
    ros : int, optional
        The ROS domain.
    remap : list of str, optional
        Rules, `from:=to`.
    humble : bool
        Whether what is published has no hashes of types.

    Raises
    ------
    ConfigError
        If there are rules, or is no hash, without a domain.
    WireError
        If a rule or the namespace is malformed.
    """
    from recorders.rmw_zenoh.names import NodeName
    from recorders.wire.keys.ros_keys import RosKeys
    from recorders.wire.keys.topic_keys import NamespaceKeys

    if ros is None:
        if remap and not of_settings("remap"):
            raise ConfigError(f"--remap: expected {_OPTION} beside it, found {remap[0]!r:.100} alone")
        if humble and not of_settings("humble"):
            raise ConfigError(f"--humble: expected {_OPTION} beside it, found it alone")
        return NamespaceKeys(namespace)
    plain = _NO_NAME.sub("_", name)
    node = NodeName.remapped(f"_{plain}" if plain[:1].isdigit() else plain, "/", remap or ())
    return RosKeys(ros, node, namespace=namespace, humble=humble)


def refuse_humble(verb: str, *, given: bool) -> None:
    """Raise ConfigError if `--humble` is given to a verb that publishes nothing."""
    if given and not of_settings("humble"):
        raise ConfigError(f"--humble: expected a verb that publishes, found {verb}, which takes topics either way")


def with_domain(arguments: Sequence[str]) -> list[str]:
    """Return a command line in which `--ros` without a number has the one of the environment, as ROS has it.

    Raises
    ------
    ConfigError
        If the environment's is no number.
    """
    following = [*arguments[1:], ""]
    return [
        f"{_OPTION}={_usual_domain()}" if argument == _OPTION and not after.lstrip("-").isdigit() else argument
        for argument, after in zip(arguments, following, strict=False)
    ]


def _usual_domain() -> int:
    text = os.environ.get(_VARIABLE, "") or "0"
    if not _is_domain(text):
        raise ConfigError(f"{_VARIABLE}: expected 0 to {MAX_DOMAIN}, found {text[:40]!r}")
    return int(text)
