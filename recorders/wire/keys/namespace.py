"""Keys of a namespace: those of topics, and those of what a sender and a consumer ask each other."""

import re
from functools import lru_cache

from recorders.errors import WireError
from recorders.protocol.frames import batch_topic

DEFAULT_NAMESPACE = "reenact"

_CHUNK = r"(?!@)[^/*#?$\0\ud800-\udfff]+"  # no wildcard of Zenoh's, no control key of ours, and nothing but text
_TOPIC = re.compile(f"{_CHUNK}(/{_CHUNK})*")
_MAX_TOPIC = 1000  # characters; the length of a name in a batch has 16 bits


def check_name(name: str) -> None:
    """Raise WireError unless a node's name can be part of a key."""
    if not re.fullmatch(r"[A-Za-z0-9_.-]{1,100}", name):
        raise WireError(f"name: expected letters, digits, '_', '.' or '-', found {name[:100]!r}")


def check_namespace(namespace: str) -> None:
    """Raise WireError unless a namespace can begin a key."""
    if not re.fullmatch(r"[A-Za-z0-9_.-]{1,100}(/[A-Za-z0-9_.-]{1,100})*", namespace):
        raise WireError(
            f"namespace: expected names with '/' between them, such as lab/asimo, found {namespace[:100]!r}"
        )


def batch_key(namespace: str) -> str:
    """Return the key that batches, the end and the abort travel on."""
    return message_key(namespace, batch_topic())


def control_key(namespace: str, consumer: str, verb: str) -> str:
    """Return the key of a consumer's `hello`, `status` or `ack`."""
    return f"{namespace}/@consumer/{consumer}/{verb}"


@lru_cache(maxsize=1024)
def message_key(namespace: str, topic: str) -> str:
    """Return the key of a topic: the namespace and the topic without its leading slash.

    Raises
    ------
    WireError
        If the topic cannot be part of a key of its own: it would name several keys, or one of the protocol's.
    """
    name = topic.removeprefix("/")
    if len(name) > _MAX_TOPIC or not _TOPIC.fullmatch(name):
        raise WireError(
            "topic: expected names with '/' between them, such as /hand/left/target, without any of * # ? $, "
            f"of at most {_MAX_TOPIC} characters and none that begins with @, found {topic[:100]!r}"
        )
    return f"{namespace}/{name}"
