"""The numbers of a topic's messages: what is missing in them, however many publishers number theirs."""

from recorders.mcap_format.channels import DeclaredChannel

_WITHIN = 16  # so many messages of the topic a series has to go on, or is over
_GAPS_NAMED = 5


class NumberSeries:
    """Follows the numbers on the channels of a topic, where each of several publishers numbers its own without gaps.

    A number goes on with the series whose latest number is the one before it. Any other leaves a gap behind the next
    lower latest number, until the number that follows upon that turns up after all: then there are two series, or a
    message was late. Where no series has a lower number, one begins anew. A series that does not go on soon is over.

    Attributes
    ----------
    missing : int
        Numbers that are not there.
    gaps : list of pairs of int
        The first few places of those: the numbers before and after.
    more_gaps : int
        How many places there are beside those.
    restarts : int
        How often the numbers began anew, as they do with each cycle of a replay.
    """

    def __init__(self) -> None:
        self.missing = self.more_gaps = self.restarts = 0
        self.gaps: list[tuple[int, int]] = []
        self._place = 0  # of a message in the topic
        # By channel: the latest number of each series and its place, and how many are missing behind some of them.
        self._channels: dict[DeclaredChannel | None, tuple[dict[int, int], dict[int, int]]] = {}

    def add(self, channel: DeclaredChannel | None, number: int) -> None:
        """Take in the number of the next message on a channel; it may be repeated."""
        self._place += 1
        latest, behind = self._channels.get(channel) or self._channels.setdefault(channel, ({}, {}))
        if len(latest) > 1:
            self._end_series(latest, behind)
        if latest.pop(number - 1, None) is None:
            self._begin_or_jump(latest, behind, number)
        elif number - 1 in behind:
            self._close_gap(number - 1, behind.pop(number - 1))
        latest.pop(number, None)  # what went on last stands last
        latest[number] = self._place

    def _end_series(self, latest: dict[int, int], behind: dict[int, int]) -> None:
        for number in [number for number, place in latest.items() if place < self._place - _WITHIN]:
            if len(latest) > 1:
                del latest[number]
                behind.pop(number, None)

    def _begin_or_jump(self, latest: dict[int, int], behind: dict[int, int], number: int) -> None:
        if number in latest:
            return
        before = max((each for each in latest if each < number), default=None)
        if before is None:
            self.restarts += bool(latest)
        elif before not in behind:
            behind[before] = number - before - 1
            self.missing += behind[before]
            if len(self.gaps) < _GAPS_NAMED:
                self.gaps.append((before, number))
            else:
                self.more_gaps += 1

    def _close_gap(self, before: int, missing: int) -> None:
        """Take back a gap: the number that follows upon the one before it has come."""
        self.missing -= missing
        gap = before, before + missing + 1
        if gap in self.gaps:
            self.gaps.remove(gap)
        else:
            self.more_gaps -= 1
