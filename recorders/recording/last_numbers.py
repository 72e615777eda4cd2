"""The last number of each publisher on each topic, and what is missing before the next."""

from collections import OrderedDict

from recorders.writing.writer import MAX_CHANNELS

_MOST_KNOWN = MAX_CHANNELS  # as many topics as a log holds, of one publisher each; anyone may name more


class LastNumbers:
    """The numbers that came last, by topic and publisher; those of which nothing came for longest are forgotten."""

    def __init__(self) -> None:
        self._last: OrderedDict[tuple[str, bytes], int] = OrderedDict()

    def missing_before(self, topic: str, publisher: bytes, number: int) -> int:
        """Note a message, and return how many of the same publisher before it did not come.

        Parameters
        ----------
        topic : str
            Its topic.
        publisher : bytes
            Who numbered it.
        number : int
            Its number there; 0 is that of a publisher that begins anew.
        """
        last = self._last.pop((topic, publisher), number - 1)
        self._last[topic, publisher] = last if 0 < number < last else number  # one that is late changes nothing
        if len(self._last) > _MOST_KNOWN:
            self._last.popitem(last=False)
        return max(0, number - last - 1)
