"""When targets and commands arrive at a process of its own, by the states that they answer."""

import json
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from functools import partial

import zenoh

from recorders.cdr.codec import stamp_ns
from recorders.messages.topics import JOINT_COMMANDS, JOINT_STATES, RIGHT_TARGET, type_of
from recorders.wire.keys.topic_keys import NamespaceKeys
from recorders.wire.session import SessionConfig, open_session

BEGIN, END = (JOINT_STATES, RIGHT_TARGET), JOINT_COMMANDS


class CommandWatch:
    """What a watching process has seen."""

    def __init__(self, process: "subprocess.Popen[str]") -> None:
        self._process = process
        self.take()

    def take(self) -> dict[str, list[float]]:
        """Return the times from state to command and from target to command since the last call [us]."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write("\n")
        self._process.stdin.flush()
        found: dict[str, list[float]] = json.loads(self._process.stdout.readline())
        return found


@contextmanager
def watched_commands(endpoint: str, namespace: str) -> Iterator[CommandWatch]:
    """Watch the commands of a namespace while the block runs."""
    command = [sys.executable, __file__, endpoint, namespace]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        try:
            yield CommandWatch(process)
        finally:
            process.kill()


def main() -> None:
    """Watch at an endpoint and in a namespace, the arguments; a line in is answered with the times since the last."""
    endpoint, namespace = sys.argv[1:]
    begun: dict[str, dict[int, float]] = {topic: {} for topic in BEGIN}
    times: dict[str, list[float]] = {topic: [] for topic in BEGIN}

    def take(topic: str, sample: zenoh.Sample) -> None:
        now_us = time.perf_counter() * 1e6
        stamp = stamp_ns(type_of(topic), sample.payload.to_bytes()) or 0
        if topic != END:
            begun[topic][stamp] = now_us
            return
        for begin in BEGIN:
            if (put_us := begun[begin].pop(stamp, None)) is not None:
                times[begin].append(now_us - put_us)

    keys = NamespaceKeys(namespace)
    with open_session(SessionConfig(connect=(endpoint,))) as session, ExitStack() as stack:
        for topic in (*BEGIN, END):
            stack.enter_context(keys.subscribing(session, topic, type_of(topic), partial(take, topic), at_once=True))
        for _ in sys.stdin:
            print(json.dumps(times), flush=True)
            for found in times.values():
                found.clear()


if __name__ == "__main__":
    main()
