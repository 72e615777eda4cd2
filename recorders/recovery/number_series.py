"""The numbers of a topic's messages: what is missing in them, however many publishers number theirs."""

from dataclasses import dataclass, field

from recorders.mcap_format.channels import DeclaredChannel

_WITHIN = 16  # so many messages of its channel a series has to go on, or is over
_GAPS_NAMED = 5


@dataclass(slots=True)
class _Channel:
    """The latest number of each series, with the place of its message, and how many are missing behind some of them.

    What went on last stands last.
    """

    latest: dict[int, int] = field(default_factory=dict)
    behind: dict[int, int] = field(default_factory=dict)
    place: int = 0


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
        self._channels: dict[DeclaredChannel | None, _Channel] = {}

    def add(self, channel: DeclaredChannel | None, number: int) -> None:
        """Take in the number of the next message on a channel; it may be repeated."""
        known = self._channels.get(channel) or self._channels.setdefault(channel, _Channel())
        latest, behind = known.latest, known.behind
        known.place += 1
        if len(latest) > 1:
            self._end_series(known)
        if latest.pop(number - 1, None) is None:
            self._begin_or_jump(known, number)
        elif number - 1 in behind:
            self._close_gap(number - 1, behind.pop(number - 1))
        if latest.pop(number, None) is not None:
            behind.pop(number, None)
        latest[number] = known.place

    def _end_series(self, known: _Channel) -> None:
        for number in [number for number, place in known.latest.items() if place < known.place - _WITHIN]:
            if len(known.latest) > 1:
                del known.latest[number]
                known.behind.pop(number, None)

    def _begin_or_jump(self, known: _Channel, number: int) -> None:
        if known.latest.get(number) == known.place - 1:  # a message that is repeated, or of another who is as far
            return
        before = max((each for each in known.latest if each < number), default=None)
        if before is None:
            self.restarts += bool(known.latest)
        elif before not in known.behind:
            known.behind[before] = number - before - 1
            self.missing += known.behind[before]
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
