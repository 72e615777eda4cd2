"""A process in the simulated world: stalled, killed at any of its steps and started anew, with a clock that jumps."""

from collections import Counter
from collections.abc import Callable, Iterable
from typing import Any

from simulation.scenario import Fault
from simulation.world import SECOND, World

_EPOCH_NS = 1_000_000 * SECOND  # where the clocks on the wall begin


class KilledError(Exception):
    """This process is killed, here."""


class Node:
    """What sender and consumers have in common: their steps, their clock, and that they are killed and start again.

    Parameters
    ----------
    faults : iterable of Fault
        Those of this node that are not packets'; `kill` at one of its steps is obeyed here.
    occurred : counter of str
        Counts the faults that occurred.

    Attributes
    ----------
    is_up : bool
        Whether the process runs.
    check : callable
        Checks what the process promises, whenever it has done something.
    """

    def __init__(self, world: World, name: str, *, faults: Iterable[Fault], occurred: Counter[str]) -> None:
        self.world = world
        self.name = name
        self.is_up = False
        self.check: Callable[[], None]
        self.occurred = occurred
        self._kills = {fault.at: fault.amount for fault in faults if (fault.kind, fault.where) == ("kill", name)}
        self._steps = 0
        self._life = 0  # events of an earlier one are nobody's
        self._stalled_until_ns = 0
        self._jumped_ns = self._wall_jumped_ns = 0
        self._alarm_ns: int | None = None

    @property
    def now_s(self) -> float:
        """The time on this node's monotonic clock."""
        return (self.world.now_ns + self._jumped_ns) / 1e9

    def begin(self) -> None:
        """Start the process, or start it anew."""
        self._life += 1
        self.is_up = True
        self._alarm_ns = None
        self.world.note(f"{self.name} begins")
        self._run(self.on_begin, ())

    def stop(self) -> None:
        """End the process."""
        self._life += 1
        self.is_up = False

    def end(self, gone_ns: int) -> None:
        """End the process; it is started anew after a time."""
        self.stop()
        self.world.note(f"{self.name} is gone for {gone_ns / SECOND:.3f} s")
        self.world.after(gone_ns, self.begin)

    def stall(self, duration_ns: int) -> None:
        """Let nothing go on in the process for a time."""
        self._stalled_until_ns = max(self._stalled_until_ns, self.world.now_ns + duration_ns)

    def jump(self, duration_ns: int) -> None:
        """Let the clock on the wall jump, and with it the monotonic one if it is ahead."""
        self._wall_jumped_ns += duration_ns
        self._jumped_ns += max(0, duration_ns)
        self.hand(lambda: None)  # it is noticed

    def wall_ns(self) -> int:
        """Return the time on the wall's clock."""
        return _EPOCH_NS + self.world.now_ns + self._wall_jumped_ns

    def hand(self, do: Callable[..., None], *arguments: Any) -> None:
        """Let the process do something: now, after a stall, or not at all if it is gone by then."""
        if not self.is_up:
            return
        if self._stalled_until_ns > self.world.now_ns:
            self.world.at(self._stalled_until_ns, self._hand, self._life, do, arguments)
        else:
            self._run(do, arguments)

    def later(self, delay_ns: int, do: Callable[..., None], *arguments: Any) -> None:
        """Let the process do something after a time, unless it is gone by then."""
        if self.is_up:
            self.world.after(delay_ns, self._hand, self._life, do, arguments)

    def step(self) -> None:
        """Count a step; it may be the last one."""
        self._steps += 1
        if self._steps in self._kills:
            raise KilledError

    def on_begin(self) -> None:
        """Begin with nothing but what is durable."""
        raise NotImplementedError

    def on_event(self) -> None:
        """Do what follows from any event."""
        raise NotImplementedError

    def deadline_s(self) -> float:
        """Return when the process wants to be woken, on its own clock [s]."""
        raise NotImplementedError

    def on_time(self) -> None:
        """Do what is due now."""
        raise NotImplementedError

    def _hand(self, life: int, do: Callable[..., None], arguments: tuple[Any, ...]) -> None:
        if life == self._life:
            self.hand(do, *arguments)

    def _run(self, do: Callable[..., None], arguments: tuple[Any, ...]) -> None:
        try:
            self.step()
            do(*arguments)
            self.on_event()
        except KilledError:
            self.occurred[f"{'sender' if self.name == 'replay' else 'consumer'} killed"] += 1
            self.world.note(f"{self.name} is killed at step {self._steps}")
            self.end(self._kills[self._steps])
        else:
            if self.is_up:
                self.check()
                self._set_alarm()

    def _set_alarm(self) -> None:
        """See to it that the process is woken at its deadline, once."""
        deadline_s = self.deadline_s()
        if deadline_s > 1e9:
            return
        at_ns = max(int(max(deadline_s, 0.0) * 1e9) + 1 - self._jumped_ns, self.world.now_ns)
        if self._alarm_ns is None or at_ns < self._alarm_ns:
            self._alarm_ns = at_ns
            self.world.at(at_ns, self._ring, self._life, at_ns)

    def _ring(self, life: int, at_ns: int) -> None:
        if life != self._life or self._alarm_ns != at_ns:
            return
        self._alarm_ns = None
        if self.now_s >= self.deadline_s():
            self._hand(life, self.on_time, ())
        else:
            self._set_alarm()
