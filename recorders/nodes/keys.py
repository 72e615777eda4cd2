"""The keys under which every long-running node of a namespace is found, whatever it is."""

import re
from typing import NamedTuple

KINDS = ("robot", "controller", "learner", "recorder", "replay", "explorer")
"""Kinds of nodes."""

_KEY = re.compile(r"/@node/([a-z]{1,20})/([A-Za-z0-9_.-]{1,100})/(alive|status)")
_NO_NAME = re.compile(r"[^A-Za-z0-9_.-]+")


class NodeId(NamedTuple):
    """A node's kind and name."""

    kind: str
    name: str

    def __str__(self) -> str:
        """Return both, as messages name a node."""
        return f"{self.kind} {self.name}"


def node_key(namespace: str, kind: str, name: str, verb: str) -> str:
    """Return the key of a node's liveliness token (`alive`) or of its `status`; kind and name may be wildcards."""
    return f"{namespace}/@node/{kind}/{name}/{verb}"


def controller_key(namespace: str, name: str, verb: str) -> str:
    """Return the key of a served controller's liveliness token (`alive`) or of its own, full status (`status`)."""
    return f"{namespace}/@controller/{name}/{verb}"


def node_of(namespace: str, key: str) -> NodeId | None:
    """Return the node that a key belongs to, None if it is no node's: anybody may declare any key."""
    found = _KEY.fullmatch(key.removeprefix(namespace))
    return NodeId(found[1], found[2]) if found and key.startswith(namespace) and found[1] in KINDS else None


def node_name(text: str) -> str:
    """Return a text as a name that can be part of a key."""
    return _NO_NAME.sub("_", text)[:100] or "unnamed"
