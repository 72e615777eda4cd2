"""A consumer that keeps a hash of what it is fed; run as a script, it does so in a process of its own."""

import hashlib
import json
import sys
import time
from collections.abc import Iterator
from typing import Any

from recorders.errors import MessageError
from recorders.messages.record import RecordedMessage
from recorders.protocol.stream import Offer

_PATIENCE_S = 120.0


class Collector:
    """Takes a stream from `start`; may refuse, fail at a message, print when it takes one, or be slow."""

    def __init__(
        self, *, start: int = 0, refuse: str = "", fail_at: int = -1, tell_at: int = -1, delay_s: float = 0.0
    ) -> None:
        self._start = start
        self._refuse = refuse
        self._fail_at = fail_at
        self._tell_at = tell_at
        self._delay_s = delay_s

    def hello(self, offer: Offer) -> int:
        if self._refuse:
            raise MessageError(self._refuse)
        return self._start

    def consume(self, messages: Iterator[RecordedMessage]) -> dict[str, Any]:
        digest, count = hashlib.sha256(), 0
        for message in messages:
            if self._start + count == self._fail_at:
                raise MessageError(f"message {self._fail_at} is not wanted")
            if self._start + count == self._tell_at:
                print(f"takes message {self._tell_at}", flush=True)
            digest.update(repr(message).encode())
            count += 1
            if self._delay_s:
                time.sleep(self._delay_s)
        return {"count": count, "sha256": digest.hexdigest()}


def main() -> None:
    from recorders.errors import ReenactError
    from recorders.wire.receiver import Receiver, ReceiverConfig
    from recorders.wire.session import SessionConfig, open_session

    endpoint, name, options = sys.argv[1], sys.argv[2], json.loads(sys.argv[3])
    wait_s = options.pop("wait_s", _PATIENCE_S)
    silence_s = options.pop("silence_s", _PATIENCE_S)
    with (
        open_session(SessionConfig(connect=(endpoint,), wait_s=_PATIENCE_S)) as session,
        Receiver(session, config=ReceiverConfig(name=name, silence_s=silence_s)) as receiver,
    ):
        try:
            print(json.dumps(receiver.serve(Collector(**options), wait_s=wait_s)))
        except ReenactError as error:
            print(json.dumps({"error": str(error)}))


if __name__ == "__main__":
    main()
