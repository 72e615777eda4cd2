"""How long a sender goes on asking a consumer that is silent, or receives nothing."""

from recorders.errors import WireError


class Patience:
    """How long each consumer has been silent, or has received nothing of what was sent.

    Parameters
    ----------
    patience_s : float
        How long that may last [s].

    Attributes
    ----------
    is_tried : bool
        Whether messages, or the end, wait for the consumers.
    """

    def __init__(self, patience_s: float) -> None:
        self._patience_s = patience_s
        self._received: dict[str, int | None] = {}
        self._since_s: dict[str, float] = {}
        self.is_tried = False

    def begin(self) -> None:
        """Begin to wait for the consumers, unless they are waited for already."""
        if not self.is_tried:
            self._received.clear()
        self.is_tried = True

    def end(self) -> None:
        """Wait for nobody any more."""
        self.is_tried = False

    def lacks(self, name: str, received: int | None, now_s: float, *, lacking: bool) -> bool:
        """Note an answer, or that there was none; True if the consumer lacks the same message as at the one before.

        Raises
        ------
        WireError
            If that has gone on for too long.
        """
        again = lacking and name in self._received and self._received[name] == received
        if not again:
            self._since_s[name] = now_s
        elif now_s - self._since_s[name] > self._patience_s:
            what = "no answer" if received is None else f"message {received} does not arrive"
            raise WireError(f"{name}: {what} for {self._patience_s:g} s; the rest of the stream is unconfirmed")
        self._received[name] = received
        return again
