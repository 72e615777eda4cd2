"""Publishers of a recording in a ROS domain: how many messages came of each, and how many did not, by their numbers."""

from collections import OrderedDict
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

MAX_PUBLISHERS = 1000
"""As many are known at a time: anyone may name as many as they like."""


@dataclass
class PublisherCount:
    """What came of one publisher.

    Attributes
    ----------
    node : str
        Full name of its node; empty if the graph names none.
    first, last : int
        The number that came first, and the highest that came.
    messages : int
        How many messages came.
    missing : int
        How many numbers between those did not.
    repeated : int
        How many messages came after others of a higher number, or twice.
    """

    node: str
    first: int
    last: int
    messages: int = 1
    missing: int = 0
    repeated: int = 0


class PublisherCounts:
    """Counts by topic and publisher.

    Attributes
    ----------
    forgotten : int
        How many publishers were forgotten, as others came after them; what was missing of them was counted.
    """

    def __init__(self) -> None:
        self._known: OrderedDict[tuple[str, bytes], PublisherCount] = OrderedDict()
        self.forgotten = 0

    def note(self, topic: str, gid: bytes, number: int, *, node_of: Callable[[], str] = str) -> int:
        """Note a message, and return how many before it did not come.

        Parameters
        ----------
        topic : str
            Its topic.
        gid : bytes
            The publisher.
        number : int
            The publisher's own number.
        node_of : callable
            Returns the name of its node; called for the first message of a publisher.
        """
        known = self._known.get((topic, gid))
        if known is None:
            self._known[topic, gid] = PublisherCount(node_of(), number, number)
            if len(self._known) > MAX_PUBLISHERS:
                self._known.popitem(last=False)
                self.forgotten += 1
            return 0
        self._known.move_to_end((topic, gid))
        known.messages += 1
        if number <= known.last:
            known.repeated += 1
            return 0
        missing = number - known.last - 1
        known.missing += missing
        known.last = number
        return missing

    def rows(self) -> list[dict[str, Any]]:
        """Return the counts as JSON values, in order of topics and publishers."""
        ordered = sorted(self._known.items(), key=lambda item: item[0])
        return [{"topic": topic, "publisher": gid.hex(), **asdict(count)} for (topic, gid), count in ordered]

    def to_dict(self) -> dict[str, Any]:
        """Return the counts as entries of a result and of a manifest; none where there are no such publishers."""
        found: dict[str, Any] = {"publishers": self.rows()} if self._known else {}
        return found | ({"publishers_forgotten": self.forgotten} if self.forgotten else {})
