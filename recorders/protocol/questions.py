"""Whom a sender greets and asks how far it is, and when: one question to each consumer at a time."""

import math
from collections.abc import Iterator

from recorders.protocol.packets import Ask, Packet

ALIVE_S = 1.0
"""How often each consumer is asked how far it is, which also shows it that its sender lives [s]."""

_ANSWER_S = 5.0  # how long one answer may take
_HELLO_S = 0.5  # from one hello to the next while the consumer decides: any of them, or its answer, may be lost
_RETRY_S = 0.05  # from one hello that nobody answers to the next


class Questions:
    """Questions that are due, asked and answered.

    Parameters
    ----------
    consumers : sequence of str
        Who is to be greeted, one after the other.
    wait_s : float
        How long each may take to appear, and as long again to decide [s].

    Attributes
    ----------
    ungreeted : list of str
        Who is still to accept the offer; the first is being greeted.
    """

    def __init__(self, consumers: tuple[str, ...], wait_s: float) -> None:
        self._wait_s = wait_s
        self._hello_at_s = math.inf
        self._appeared: set[bytes] = set()  # instances of consumers
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
        self._greet(now_s)
        self._begin_to_wait(now_s)
        return bool(self.ungreeted)

    def greet_later(self, now_s: float) -> None:
        """Greet the same again; soon if nobody is there, as no other hello may still be answered."""
        if not self._hellos:
            self._hello_at_s = now_s + _RETRY_S

    def greet_instance(self, instance: bytes, now_s: float) -> None:
        """Greet the instance that a consumer is by now; one that has just appeared may take its time."""
        self._greet(now_s)
        if instance not in self._appeared:
            self._appeared.add(instance)
            self._begin_to_wait(now_s)

    def has_waited(self, now_s: float) -> bool:
        """Whether the consumer that is greeted has taken too long to appear, or to answer."""
        longest_s = max(self._wait_s, _ANSWER_S) if self._hellos else self._wait_s
        return bool(self.ungreeted) and self._waited(now_s) > longest_s

    @property
    def _hellos(self) -> list[int]:
        """The numbers of those that await their answers, all from the same consumer."""
        return [number for number, ask in self._asked.items() if ask.verb == "hello"]

    def _greet(self, now_s: float) -> None:
        """Greet at once, and await no earlier hello: who answers it takes no offer."""
        for number in self._hellos:
            del self._asked[number]
        self._hello_at_s = now_s if self.ungreeted else math.inf

    def _begin_to_wait(self, now_s: float) -> None:
        self._greeted_at_s, self._waited_s = now_s, 0.0  # when a hello was last due, and what was waited before that

    def _waited(self, now_s: float) -> float:
        """Return the time waited [s], in which a stall of this end, or a jump of its clock, is but one hello's."""
        return self._waited_s + min(now_s - self._greeted_at_s, _HELLO_S)

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
            self._waited_s, self._greeted_at_s = self._waited(now_s), now_s
            self._hello_at_s = now_s + _HELLO_S
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
        ask = self._asked[self._number] = Ask(self._number, name, verb, packet, _ANSWER_S)
        return ask

    def is_open(self, ask: Ask) -> bool:
        """Whether the answer to a question is awaited."""
        return ask.number in self._asked

    def close(self, ask: Ask) -> None:
        """Await no more answer to a question."""
        del self._asked[ask.number]
