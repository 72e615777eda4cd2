"""Visitors of the page: one leads the robot, the others look on until they take over."""

import threading


class Visitors:
    """Who is there, by number, and who leads; whoever comes first does, and after that whoever takes over."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._there: list[int] = []
        self._leader: int | None = None

    def __len__(self) -> int:
        return len(self._there)

    @property
    def leader(self) -> int | None:
        """The visitor who leads, if any does."""
        return self._leader

    def come(self, visitor: int) -> None:
        """Let a visitor in, who leads if nobody does."""
        with self._lock:
            self._there.append(visitor)
            if self._leader is None:
                self._leader = visitor

    def go(self, visitor: int) -> None:
        """Note that a visitor has gone; whoever has been there longest leads on."""
        with self._lock:
            if visitor in self._there:
                self._there.remove(visitor)
            if self._leader == visitor:
                self._leader = self._there[0] if self._there else None

    def take_over(self, visitor: int) -> None:
        """Let a visitor who is there lead from now on."""
        with self._lock:
            if visitor in self._there:
                self._leader = visitor

    def leads(self, visitor: int | None) -> bool:
        """Whether a visitor leads."""
        return visitor is not None and visitor == self._leader

    def line(self, visitor: int) -> str:
        """Return what a visitor is told of who leads."""
        others = len(self) - 1
        if self.leads(visitor):
            return "You lead the robot." + (f" {others} more look on." if others else "")
        return "You look on: another visitor leads the robot."
