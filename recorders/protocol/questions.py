"""Whom a sender greets and asks how far it is, and when: one question to each consumer at a time."""

import math
from collections.abc import Iterator

from recorders.protocol.packets import Ask, Packet

ALIVE_S = 1.0
"""How often each consumer is asked how far it is, which also shows it that its sender lives [s]."""

_ANSWER_S = 5.0  # how long one answer may take
_HELLOS = 5  # how often a hello is asked in the time that its answer may take: question or answer may be lost
_RETRY_S = 0.05  # from one hello that nobody answers to the next


class Questions:
    """Questions that are due, asked and answered.

    Parameters
    ----------
    consumers : sequence of str
        Who is to be greeted, one after the other.
    wait_s : float
        How long each may take to appear [s].

    Attributes
    ----------
    ungreeted : list of str
        Who is still to accept the offer; the first is being greeted.
    """

    def __init__(self, consumers: tuple[str, ...], wait_s: float) -> None:
        self._wait_s = wait_s
        self._hello_at_s = self._hello_until_s = self._hello_asked_s = math.inf
        self._hello_timeout_s = max(wait_s, _ANSWER_S) / _HELLOS
        self._ask_at_s: dict[str, float] = {}  # who has accepted, and when it is asked next: never while it is
        self._unconfirmed: set[str] = set()  # who has published that it is through
        self._asked: dict[int, Ask] = {}
        self._number = 0
        self.ungreeted = list(consumers)

    @property
    def deadline_s(self) -> float:
        """When the next question is due [s]; infinite if none is."""
        return min(self._hello_at_s, *self._ask_at_s.values(), math.inf)

    @property
    def are_all_answered(self) -> bool:
        """Whether no answer is awaited."""
        return not self._asked

    def greet_next(self, now_s: float) -> bool:
        """Begin to greet who is next; False if everybody has accepted."""
        self._hello_at_s, self._hello_until_s = (now_s, now_s + self._wait_s) if self.ungreeted else (math.inf,) * 2
        return bool(self.ungreeted)

    def greet_later(self, now_s: float, *, at_once: bool = False) -> bool:
        """Greet the same again, as nobody has taken the offer; False if that has taken too long."""
        is_lost = now_s >= self._hello_asked_s + self._hello_timeout_s  # that nobody is there is known at once
        self._hello_at_s = now_s if at_once else now_s + _RETRY_S
        return now_s <= self._hello_until_s + (max(0.0, _ANSWER_S - self._wait_s) if is_lost else 0.0)

    def has_accepted(self, name: str, now_s: float) -> None:
        """Note a consumer that has accepted the offer: from now on it is asked how far it is."""
        self.ungreeted.remove(name)
        self.ask_later(name, now_s)

    def has_restarted(self, name: str) -> bool:
        """Note a consumer that is to be greeted anew; True if it is the only one."""
        del self._ask_at_s[name]
        self.ungreeted.append(name)
        return len(self.ungreeted) == 1

    def ask_later(self, name: str, now_s: float) -> None:
        """Ask a consumer again after a while; at once if it has published that it is through."""
        self._ask_at_s[name] = now_s if name in self._unconfirmed else now_s + ALIVE_S
        self._unconfirmed.discard(name)

    def confirm(self, name: str, now_s: float) -> None:
        """Ask a consumer as soon as possible: it has published that it is through."""
        if name in self._ask_at_s:
            self._unconfirmed.add(name)
            if not math.isinf(self._ask_at_s[name]):
                self.ask_later(name, now_s)

    def take_due(self, now_s: float) -> Iterator[tuple[str, str]]:
        """Yield whom to ask for what now."""
        if self._hello_at_s <= now_s:
            self._hello_at_s, self._hello_asked_s = math.inf, now_s
            yield self.ungreeted[0], "hello"
        for name, at_s in self._ask_at_s.items():
            if at_s <= now_s:
                self._ask_at_s[name] = math.inf
                yield name, "status"

    def take_accepted(self) -> list[str]:
        """Return who has accepted the offer; nothing is due or awaited any more."""
        names = list(self._ask_at_s)
        self._asked.clear()
        self._ask_at_s.clear()
        return names

    def ask(self, name: str, verb: str, packet: Packet) -> Ask:
        """Return a question, of which the answer is awaited."""
        self._number += 1
        timeout_s = self._hello_timeout_s if verb == "hello" else _ANSWER_S
        ask = self._asked[self._number] = Ask(self._number, name, verb, packet, timeout_s)
        return ask

    def is_open(self, ask: Ask) -> bool:
        """Whether the answer to a question is awaited."""
        return ask.number in self._asked

    def close(self, ask: Ask) -> None:
        """Await no more answer to a question."""
        del self._asked[ask.number]
