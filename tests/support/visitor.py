"""One end of a session in a process of its own: takes a stream, feeds one, or tries everything a peer can try."""

import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from functools import partial
from itertools import count
from pathlib import Path
from typing import Any, TypeAlias

import zenoh
from collector import Collector

from recorders.errors import ReenactError
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import LEARNER_TOPICS
from recorders.protocol.stream import Offer
from recorders.wire.receiver import Receiver, ReceiverConfig
from recorders.wire.session import SessionConfig, open_session, single_network_thread
from replay.transports.sender_config import SenderConfig
from replay.transports.zenoh import ZenohTransport

Role: TypeAlias = Callable[[zenoh.Session, float], dict[str, Any]]

COUNT = 200
PATIENCE_S = 120.0
ROUNDS = 10
"""How often a guest tries everything before it says so."""
COMMANDS = "reenact/joint_commands"
ERRORS = "reenact/learner/error"
HELLO = "reenact/@consumer/learner/hello"
TRIED = "tried everything"
OFFER = Offer(run="ab" * 16, schedule={}, logs=[])


@contextmanager
def visitor(role: str, *, seconds: float = PATIENCE_S, **session: Any) -> Iterator[subprocess.Popen[str]]:
    """Start one in a process of its own; see `main` for what it is told."""
    command = [sys.executable, __file__, role, json.dumps(session | {"seconds": seconds}, default=str)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        try:
            yield process
        finally:
            process.kill()


def await_ready(process: subprocess.Popen[str]) -> None:
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n", process.communicate(timeout=120)


def await_words(process: subprocess.Popen[str], words: set[str]) -> None:
    """Wait until a host or a guest has printed all of these words."""
    assert process.stdout is not None
    while words:
        line = process.stdout.readline()
        assert line, words
        words = words - {line.rstrip("\n")}


def outcome(process: subprocess.Popen[str]) -> dict[str, Any]:
    """Return what a process says last, having checked that all went well and nothing stands on standard error."""
    out, err = process.communicate(timeout=120)
    assert (process.returncode, err) == (0, "")
    result: dict[str, Any] = json.loads(out.splitlines()[-1])
    return result


def refusal(process: subprocess.Popen[str]) -> str:
    """Return the one line with which a process gave up, having checked that it is one, and the exit status."""
    _, err = process.communicate(timeout=120)
    assert process.returncode == 2, err
    (line,) = err.splitlines()
    return line


def stream_from(start: int) -> Iterator[RecordedMessage]:
    """The stream that `replay` sends."""
    for index in range(start, COUNT):
        topic = LEARNER_TOPICS[index % 3]
        yield RecordedMessage(topic.name, topic.type, f"payload {index}".encode(), index, index)


def learn(session: zenoh.Session, seconds: float, *, silence_s: float) -> dict[str, Any]:
    with Receiver(session, config=ReceiverConfig(silence_s=silence_s)) as receiver:
        say("ready")
        return receiver.serve(Collector(), wait_s=seconds)


def replay(session: zenoh.Session, seconds: float) -> dict[str, Any]:
    return ZenohTransport(session, config=SenderConfig(wait_s=seconds)).deliver(OFFER, stream_from)["learner"]


def host(session: zenoh.Session, seconds: float) -> dict[str, Any]:
    """Publish commands and errors, ask for a learner, until SIGTERM; print what is received, and all of it at last."""
    return converse(session, seconds, name="host", publishes=(COMMANDS, ERRORS))


def guest(session: zenoh.Session, seconds: float) -> dict[str, Any]:
    """Publish on the learner's inputs and on the stream's keys, and answer for the learner; else as the host does."""
    keys = ("reenact/hand/left/target", "reenact/replay/batch", "reenact/@consumer/learner/ack", COMMANDS)
    return converse(session, seconds, name="guest", publishes=keys)


def converse(session: zenoh.Session, seconds: float, *, name: str, publishes: tuple[str, ...]) -> dict[str, Any]:
    other = {"host": "guest", "guest": "host"}[name]
    heard: set[str] = set()

    def note(word: str, payload: zenoh.ZBytes | None) -> None:
        if payload is not None and payload.to_string() == other and word not in heard:
            heard.add(word)
            say(word)

    def on_query(query: zenoh.Query) -> None:
        with query:
            note("asked", query.payload)
            query.reply(query.key_expr, name)

    # A wildcard that is not allowed must not hide a key that is: each is asked for by itself.
    watched = ("**", "reenact/**", "reenact/@consumer/**", COMMANDS, ERRORS)
    for key in watched:
        session.declare_subscriber(key, lambda sample: note(str(sample.key_expr), sample.payload))
    session.declare_queryable(HELLO, on_query)
    leave = threading.Event()
    signal.signal(signal.SIGTERM, lambda signum, frame: leave.set())
    say("ready")
    end = time.monotonic() + seconds
    for tried in count(1):
        for key in publishes:
            session.put(key, name)
        for reply in session.get(HELLO, payload=name, timeout=0.5):
            if reply.ok is not None:
                note("answered", reply.ok.payload)
        if tried == ROUNDS:
            say(TRIED)
        if leave.wait(0.05) or time.monotonic() > end:
            break
    return {"heard": sorted(heard)}


def idle(session: zenoh.Session, seconds: float) -> dict[str, Any]:
    say("ready")
    time.sleep(seconds)
    return {}


def say(line: str) -> None:
    """Print a line whole, also where another thread prints one."""
    os.write(sys.stdout.fileno(), f"{line}\n".encode())


def main() -> None:
    """Arguments: role, then JSON with fields of `SessionConfig`, as_it_comes, silence_s, and the seconds to stay."""
    role, options = sys.argv[1], json.loads(sys.argv[2])
    seconds = options.pop("seconds")
    taking = partial(learn, silence_s=options.pop("silence_s", PATIENCE_S))
    threads = single_network_thread() if options.pop("as_it_comes", False) else nullcontext()
    if "config_file" in options:
        options["config_file"] = Path(options["config_file"])
    for name in {"connect", "listen"} & set(options):
        options[name] = tuple(options[name])
    try:
        with threads, open_session(SessionConfig(**{"wait_s": PATIENCE_S} | options)) as session:
            roles: dict[str, Role] = {"learn": taking, "replay": replay, "host": host, "guest": guest, "idle": idle}
            print(json.dumps(roles[role](session, seconds)))
    except ReenactError as error:
        print(f"reenact: {error}", file=sys.stderr)
        sys.exit(error.exit_status)


if __name__ == "__main__":
    main()
