"""Topic names by ROS 2's rules: which are valid, what a relative one stands for, and remapping.

The rules are those of `design.ros2.org/articles/topic_and_service_names.html`; what is refused there is refused here.
"""

import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Self

from recorders.errors import WireError

MAX_DOMAIN = 232
"""The largest domain of ROS 2; those above would need ports that there are not."""

_MAX_NAME = 247  # characters, as `rmw_validate_full_topic_name` has it
_NAME = r"(?!.*__)[A-Za-z_][A-Za-z0-9_]*"
_ABSOLUTE = re.compile(rf"(/{_NAME})+")
_NODE = re.compile(_NAME)
_SUBSTITUTION = re.compile(r"\{([^{}]*)\}")
_RULES = "expected letters, digits and single '_', no digit first, with '/' between names and none at the end"


def check_topic(name: str) -> str:
    """Return an absolute topic name.

    Raises
    ------
    WireError
        If it is not one by ROS 2's rules.
    """
    if len(name) > _MAX_NAME or not _ABSOLUTE.fullmatch(name):
        raise WireError(f"ROS topic: {_RULES}, of at most {_MAX_NAME} characters, found {name[:100]!r}")
    return name


def check_domain(domain: int) -> int:
    """Return a ROS domain; raises WireError if there is none of that number."""
    if not 0 <= domain <= MAX_DOMAIN:
        raise WireError(f"ROS domain: expected 0 to {MAX_DOMAIN}, found {domain}")
    return domain


def check_node_name(name: str) -> str:
    """Return the name of a node; raises WireError if it is not one by ROS 2's rules."""
    if not _NODE.fullmatch(name):
        raise WireError(f"ROS node: expected letters, digits and single '_', no digit first, found {name[:100]!r}")
    return name


def check_namespace(namespace: str) -> str:
    """Return a namespace: `/`, or names that each begin with `/`; raises WireError if it is not one."""
    if namespace != "/" and not _ABSOLUTE.fullmatch(namespace):
        raise WireError(f"ROS namespace: expected '/' or a name such as /lab/arm, found {namespace[:100]!r}")
    return namespace


@dataclass(frozen=True)
class NodeName:
    """A node's name and namespace, and the remapping that it was started with.

    Parameters
    ----------
    name : str
        Name of the node.
    namespace : str
        Its namespace; `/` is the root.
    rules : tuple of (str, str)
        What its topics are renamed from and to, as absolute names. The first rule that fits counts.

    Raises
    ------
    WireError
        If one of them is not a name by ROS 2's rules.
    """

    name: str
    namespace: str = "/"
    rules: tuple[tuple[str, str], ...] = field(default=())

    def __post_init__(self) -> None:
        """Check the names."""
        check_node_name(self.name)
        check_namespace(self.namespace)

    @classmethod
    def remapped(cls, name: str, namespace: str, remap: Iterable[str]) -> Self:
        """Return a node started with `from:=to` arguments; `__node:=` and `__ns:=` rename the node itself.

        Raises
        ------
        WireError
            If a rule is not of that form, or holds a name that is none.
        """
        topics = []
        for rule in remap:
            source, separator, target = rule.partition(":=")
            if not separator or not source or not target:
                raise WireError(f"remap: expected FROM:=TO, such as joint_states:=/arm/joint_states, found {rule!r}")
            if source in ("__node", "__name"):
                name = target
            elif source == "__ns":
                namespace = target
            else:
                topics.append((source.removeprefix("rostopic://"), target))
        node = cls(name, namespace)
        return cls(name, namespace, tuple((node.expand(source), node.expand(target)) for source, target in topics))

    @property
    def full_name(self) -> str:
        """The name of the node with its namespace."""
        return f"{self.namespace.rstrip('/')}/{self.name}"

    def expand(self, topic: str) -> str:
        """Return the absolute name of a topic of this node, before remapping.

        `~/x` is below the node, `x` in its namespace; `{node}`, `{ns}` and `{namespace}` are replaced.

        Raises
        ------
        WireError
            If it is no name of a topic.
        """
        namespace = self.namespace.rstrip("/")
        values = {"node": self.name, "ns": namespace, "namespace": namespace}
        unknown = [name for name in _SUBSTITUTION.findall(topic) if name not in values]
        if unknown:
            raise WireError(f"ROS topic: expected {{node}}, {{ns}} or {{namespace}}, found {{{unknown[0][:40]}}}")
        text = _SUBSTITUTION.sub(lambda found: values[found[1]], topic)
        if text == "~" or text.startswith("~/"):
            text = self.full_name + text[1:]
        elif not text.startswith("/"):
            text = f"{namespace}/{text}"
        return check_topic(text)

    def resolve(self, topic: str) -> str:
        """Return the absolute name under which a topic of this node is in the graph; raises as `expand` does."""
        name = self.expand(topic)
        return next((target for source, target in self.rules if source == name), name)

    def original(self, topic: str) -> str:
        """Return the topic of this node that is in the graph under an absolute name: `resolve` the other way."""
        return next((source for source, target in self.rules if target == topic), topic)
