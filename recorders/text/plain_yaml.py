"""YAML of plain values, as rosbag2 writes it: out, and in without what makes a large value of a small text."""

import re
from io import StringIO
from typing import Any

MAX_TEXT = 2**20
"""Longer texts are not read [bytes]."""

_DEEP = re.compile(rb"[\[{]{9}|(?:- ){9}| {99}")  # nobody's; the parser takes quadratic time for each level


def to_yaml(value: object) -> str:
    """Return plain values as YAML, a line for each."""
    from ruamel.yaml import YAML  # noqa: PLC0415  # most logs are no bags

    yaml = YAML(typ="safe")
    yaml.default_flow_style = False
    yaml.width = MAX_TEXT  # no line is broken
    text = StringIO()
    yaml.dump(value, text)
    return text.getvalue()


def from_yaml(text: bytes) -> Any:
    """Return the plain values that YAML of strangers holds.

    Raises
    ------
    ValueError
        If it is malformed, or too long, or nested too deep.
    AliasError
        If it has aliases.
    """
    from ruamel.yaml import YAML  # noqa: PLC0415  # most logs are no bags
    from ruamel.yaml.error import YAMLError  # noqa: PLC0415
    from ruamel.yaml.events import AliasEvent  # noqa: PLC0415

    if len(text) > MAX_TEXT or _DEEP.search(text):
        raise ValueError("expected YAML of some lines, found more, or deeper")
    try:
        if any(isinstance(event, AliasEvent) for event in YAML(typ="safe").parse(text.decode())):
            raise AliasError("expected YAML without aliases, found some")  # each may double what comes before it
        return YAML(typ="safe").load(text.decode())
    except (YAMLError, RecursionError) as error:
        raise ValueError("expected YAML, found other text") from error


class AliasError(ValueError):
    """YAML has aliases."""
