"""Verbs in processes of their own, beside the demo, and a learner that is fed over Zenoh there."""

import json
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from pipeline.learner_node.replay_node import replay
from recorders.errors import CheckFailed, WireError
from recorders.wire.loopback import free_endpoint
from recorders.wire.session import SessionConfig
from replay.sources.schedule import Schedule
from replay.sources.scheduled import Replay
from replay.transports.sender_config import SenderConfig

_LEARNER_START_S = 60.0  # a cold start compiles the kernels


@contextmanager
def beside(*arguments: object) -> Iterator[Callable[[], dict[str, Any]]]:
    """Run a verb in a process of its own, and end it with the block.

    Yields
    ------
    callable
        Waits for the process and returns its result; raises WireError with its complaint if it failed.
    """
    command = [sys.executable, "-m", "pipeline", *map(str, arguments), "--json"]
    with subprocess.Popen(  # noqa: S603  # our own program, no shell
        command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:

        def result() -> dict[str, Any]:
            """Return the result that the process printed."""
            printed, complaints = process.communicate()
            if process.returncode != 0:
                line = (complaints.strip().splitlines() or [f"ended with status {process.returncode}"])[-1]
                kind = CheckFailed if process.returncode == CheckFailed.exit_status else WireError
                raise kind(f"{arguments[0]}: {line.removeprefix('reenact: ')}")
            return dict(json.loads(printed))

        try:
            yield result
        except WireError:
            if process.poll():
                result()  # the reason for which the other process ended is worth more than that it does not answer
            raise
        finally:
            process.terminate()


def learn_over_zenoh(
    log: Path,
    controller: Path,
    *,
    seed: int,
    schedule: Schedule,
    advance: Callable[[float], None] = lambda fraction: None,
    options: tuple[str, ...] = (),
) -> str:
    """Feed a learner in a process of its own over loopback; return its state digest.

    Parameters
    ----------
    log, controller : Path
        What it learns from, and the controller that it writes.
    seed : int
        Of the learner.
    schedule : Schedule
        How often the log is presented.
    advance : callable
        Called with the fraction done, 0 to 1.
    options : tuple of str
        More options of `learn`, such as its rule.

    Raises
    ------
    WireError
        The learner failed, or does not answer.
    """
    endpoint = free_endpoint()
    with beside("learn", "--connect", endpoint, "--seed", seed, "--out", controller.resolve(), *options) as learner:
        replay(
            Replay([log], schedule),
            session=SessionConfig(listen=(endpoint,)),
            sender=SenderConfig(wait_s=_LEARNER_START_S),
            on_progress=advance,
        )
        return str(learner()["digest"])
