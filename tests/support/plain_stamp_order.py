"""The order of stamps in plain Python, message by message: what the order in blocks must agree with."""

SECOND = 10**9


class PlainStampOrder:
    """Where stamps lie: `next`, `late`, `ahead`, or `anew` for one at which the clock begins anew."""

    def __init__(self, topics: int) -> None:
        self._topics = topics
        self._last: dict[int, int] = {}
        self._ahead: int | None = None
        self._leaps: list[list[int]] = [[] for _ in range(topics)]
        self._behind: list[list[int]] = [[] for _ in range(topics)]

    def take(self, rank: int, stamp: int) -> str:
        """Take a stamp of a topic; one at which the clock begins anew is the first of the new one."""
        ahead = self._ahead
        if ahead is not None and stamp < ahead - 10 * SECOND:
            _go_on(self._behind[rank], stamp)
            if all(len(run) >= 10 for run in self._behind):
                self._last, self._ahead = {rank: stamp}, stamp
                self._leaps = [[] for _ in range(self._topics)]
                self._behind = [[] for _ in range(self._topics)]
                return "anew"
        if ahead is not None and stamp > ahead + 60 * SECOND:
            _go_on(self._leaps[rank], stamp)
            if len(self._leaps[rank]) < 3:
                return "ahead"
        self._leaps[rank] = []
        if stamp <= self._last.get(rank, stamp - 1):
            return "late"
        if ahead is None or stamp >= ahead - 10 * SECOND:
            self._behind = [[] for _ in range(self._topics)]
        self._last[rank] = stamp
        self._ahead = stamp if ahead is None else max(ahead, stamp)
        return "next"


def _go_on(run: list[int], stamp: int) -> None:
    """Put a stamp at the end of a run of rising ones, which else begins with it."""
    if run and stamp <= run[-1]:
        run.clear()
    run.append(stamp)
