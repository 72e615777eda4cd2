"""The clock of receivers, set forward by a test: whether a sender is silent depends on no machine's speed."""

import pytest
from waiting import wait_until

from recorders.wire.receiver import Receiver


class SteppedClock:
    """In the place of the clock of all receivers of this process; it stands still unless it is set forward.

    Parameters
    ----------
    monkeypatch : pytest.MonkeyPatch
        Restores the clock.
    """

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self._now_s = 0.0
        monkeypatch.setattr("recorders.wire.receiver.time", self)

    def monotonic(self) -> float:
        return self._now_s

    def step(self) -> float:
        """Let a second pass, and return the time [s]."""
        self._now_s += 1.0
        return self._now_s

    def pass_with_signs_of_life(self, receiver: Receiver, seconds: int) -> None:
        """Let so many seconds pass, each as soon as the receiver has noticed its sender in the one before."""
        for _ in range(seconds):
            now_s = self.step()
            wait_until(lambda: receiver._machine._last_received_s == now_s)  # noqa: B023  # asked within the loop
