"""The nodes: what runs in a process of its own and speaks Zenoh."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from pipeline.training import Trainer
from recorders.wire.receiver import Receiver, ReceiverConfig
from recorders.wire.session import SessionConfig, open_session
from replay.engine import Replay
from replay.schedule import Schedule
from replay.zenoh_transport import SenderConfig, ZenohTransport


def learn(
    trainer: Trainer,
    *,
    session: SessionConfig,
    receiver: ReceiverConfig,
    say: Callable[[str], None] = lambda line: None,
) -> dict[str, Any]:
    """Wait for a stream over Zenoh, learn from all of it, and return what is to be said of it.

    `say` is told, a line each, when the learner is ready and when it refuses an offer.

    Raises
    ------
    WireError
        If no session can be opened, or the sender fails or falls silent.
    ReenactError
        If a message is not what it should be.
    """
    with open_session(session) as opened, Receiver(opened, config=receiver, warn=say) as receiving:
        say(f"{receiver.name} waits for a replay at {', '.join(session.listen or session.connect)}")
        return receiving.serve(trainer)


def replay(
    paths: Sequence[Path],
    *,
    schedule: Schedule,
    session: SessionConfig,
    sender: SenderConfig,
    on_progress: Callable[[float], None] = lambda fraction: None,
) -> dict[str, Any]:
    """Send logs, as often as the schedule says, to consumers that are awaited, and return their results.

    Raises
    ------
    LogError
        If a log cannot be read; before anything is sent.
    WireError
        If a consumer is not there, refuses, or stops answering.
    """
    run = Replay(paths, schedule)
    total = len(run)
    with open_session(session) as opened:
        transport = ZenohTransport(opened, config=sender, on_progress=lambda consumed: on_progress(consumed / total))
        return {"run": run.run, "messages": total, "consumers": transport.deliver(run.offer(), run.stream)}
