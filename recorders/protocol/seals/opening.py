"""Opens what comes to a sender from its consumers, and refuses what is not theirs."""

from collections.abc import Callable

from recorders.errors import WireError
from recorders.protocol.incoming import MAX_REASON
from recorders.protocol.packets import Ask, Packet, read_progress
from recorders.protocol.seals.sealing import SenderSeals
from recorders.protocol.stream import Progress
from recorders.text.wording import escape_control


class UnansweredError(WireError):
    """Nobody of a consumer's name has answered."""

    def __init__(self, consumer: str, line: str) -> None:
        super().__init__(line)
        self.consumer = consumer


class Opening:
    """Answers and acknowledgements of consumers, opened.

    Parameters
    ----------
    seals : SenderSeals
        Checks them.
    refuse : callable
        Takes what it was and why, of what is not authentic.
    """

    def __init__(self, seals: SenderSeals, refuse: Callable[[str, str], None]) -> None:
        self._seals = seals
        self._refuse = refuse
        self._doubts: dict[str, str] = {}  # what was answered in a consumer's name

    def is_answer(self, ask: Ask, packet: Packet) -> bool:
        """Whether an answer is the consumer's."""
        if self._seals.is_answer(ask.consumer, ask.packet, packet):
            return True
        self._refuse(f"{ask.consumer}/{ask.verb}", "an answer that is not sealed by the consumer")
        answer = read_progress(packet)
        error = "" if answer is None else (answer.error or "")[:MAX_REASON]
        self._doubts[ask.consumer] = error or "nothing that can be trusted"
        return False

    def acknowledgement(self, consumer: str, packet: Packet) -> Progress | None:
        """Return a consumer's acknowledgement; None if it is not the consumer's."""
        if self._seals.is_acknowledgement(consumer, packet):
            return read_progress(packet)
        self._refuse(f"{consumer}/ack", "an acknowledgement that is not sealed by the consumer")
        return None

    def unanswered(self, name: str, wait_s: float) -> WireError:
        """Return the error of a consumer that has answered nothing that can be trusted within some time [s]."""
        if name not in self._doubts:
            return UnansweredError(name, f"no consumer named {name!r} answered within {wait_s:g} s")
        return WireError(
            f"{name}: it answers, but not with the key of this replay: start both with the same --key FILE, and with "
            f"the same version of this program (the answer: {escape_control(self._doubts[name])})"
        )
