"""The option `--ros`: a ROS domain in place of a namespace."""

import os
from collections.abc import Sequence
from typing import Annotated

import typer

from recorders.errors import ConfigError
from recorders.rmw_zenoh.names import MAX_DOMAIN

_OPTION = "--ros"
_VARIABLE = "ROS_DOMAIN_ID"

RosDomain = Annotated[
    int | None,
    typer.Option(
        _OPTION,
        help=f"Look at a ROS 2 domain of rmw_zenoh in place of a namespace; without a number, {_VARIABLE} or 0.",
        min=0,
        max=MAX_DOMAIN,
        metavar="DOMAIN",
    ),
]


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
    if not (text.isascii() and text.isdigit() and int(text) <= MAX_DOMAIN):
        raise ConfigError(f"{_VARIABLE}: expected 0 to {MAX_DOMAIN}, found {text[:40]!r}")
    return int(text)
