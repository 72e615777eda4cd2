"""When stamps out of time are a publisher whose clock began anew, and no longer messages that come late or astray."""

RESTART_AFTER = 10
"""Ticks in a row that must be out of time: more than are under way between two nodes, and two seconds at 5 Hz."""

LEAP_NS = 10 * 10**9
"""How much farther than time has passed a stamp may leap: a recording that is played fast has gaps."""


class RestartWatch:
    """Notices that every topic of a tick goes on, message after message, away from what was answered last.

    Parameters
    ----------
    topics : int
        How many topics a tick has; each is known by its place.

    Attributes
    ----------
    noted : bool
        Whether there is something to forget.
    """

    def __init__(self, topics: int) -> None:
        self._topics = topics
        self.reset()

    def reset(self) -> None:
        """Forget what was noted: a tick was answered, or a cycle begun."""
        self.noted = False
        self._stamps = [-1] * self._topics
        self._counts = [0] * self._topics

    def note(self, place: int, stamp: int) -> bool:
        """Note a message out of time; True once `RESTART_AFTER` in a row rose on every topic."""
        self.noted = True
        rises = stamp > self._stamps[place]
        self._counts[place] = self._counts[place] + 1 if rises else 1
        self._stamps[place] = stamp
        return min(self._counts) >= RESTART_AFTER
