"""The verb cat."""

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pipeline.cli.groups import grouped
from pipeline.cli.project_settings import of_settings
from pipeline.cli.ros_domain import refuse_humble
from pipeline.cli.sessions import LookingSession
from pipeline.terminal import console
from recorders.errors import ConfigError, LogError

if TYPE_CHECKING:
    from recorders.messages.record import RecordedMessage


@grouped
def cat(
    log: Annotated[
        Path | None,
        typer.Argument(help="A recording of any kind; without one, what is published now.", metavar="RECORDING"),
    ] = None,
    *,
    topic: Annotated[
        list[str] | None,
        typer.Option(help="Pattern of topics to print, such as '/hand/*'; all if left out.", metavar="PATTERN"),
    ] = None,
    count: Annotated[int | None, typer.Option("--count", "-n", help="End after so many.", min=1, metavar="N")] = None,
    session: LookingSession,
    as_json: Annotated[bool, typer.Option("--json", help="Print each message as one JSON object in a line.")] = False,
) -> None:
    """Print messages of a recording, or as they are published.

    Messages of any type are printed by the definitions that the recording carries, in order of log time. With --connect
    or --listen it prints what comes over Zenoh, until Ctrl-C.
    """
    if log is None and not session.is_given:
        raise ConfigError("expected a recording, or --connect or --listen for what is published now; found neither")
    if log is not None and session.is_given and not (of_settings("connect") or of_settings("listen")):
        raise ConfigError("--connect, --listen, --ros: expected no recording beside them")
    if log is not None and session.remap and not of_settings("remap"):
        raise ConfigError("--remap: expected no recording beside it: its topics are printed as they are")
    refuse_humble("cat", given=session.humble)
    patterns = frozenset(topic or ())
    if log is not None:
        _print_log(log, patterns, count, as_json=as_json)
    else:
        _print_live(session, patterns, count, as_json=as_json)


def _print_log(log: Path, patterns: frozenset[str], count: int | None, *, as_json: bool) -> None:
    from pipeline.terminal.message_lines import MessageLines
    from recorders.containers.field_values import FieldValues
    from recorders.containers.opening import open_as_it_is
    from recorders.messages.topic_patterns import chosen
    from recorders.reading.parts import one_session

    reader = open_as_it_is(one_session([log]))
    topics = chosen(patterns, reader.topics, option="--topic") if patterns else None
    lines = MessageLines(FieldValues(reader.channels), as_json=as_json)
    if not _print(reader.records(topics=topics), lines.text, count):
        raise LogError(f"{log}: expected messages, found none")


def _print_live(session: LookingSession, patterns: frozenset[str], count: int | None, *, as_json: bool) -> None:
    from functools import partial

    from pipeline.terminal.message_lines import MessageLines
    from pipeline.terminal.signals import until_stopped
    from recorders.containers.field_values import FieldValues
    from recorders.messages.topic_patterns import matches
    from recorders.nodes.spectator import watched
    from recorders.wire.keys.topic_keys import EVERY_TOPIC
    from recorders.wire.session import open_session

    keys = session.keys("cat")
    lines = MessageLines(FieldValues(), as_json=as_json)

    def report(missed: int) -> None:
        """Print how many messages were missed."""
        console.notice(f"{missed} messages came faster than they are printed, and are left out; choose with --topic")

    config = session.config()
    where = ", ".join(config.listen or config.connect)
    waits = partial(console.notice, f"waits for {where}")
    with until_stopped() as stopped, open_session(config, on_wait=waits) as opened, keys.joined(opened):
        console.notice(f"prints {keys.described(EVERY_TOPIC)} at {where}; Ctrl-C ends it")
        records = watched(opened, keys, stopped=stopped, on_missed=report)
        _print((record for record in records if not patterns or matches(record.topic, patterns)), lines.text, count)


def _print(records: "Iterable[RecordedMessage]", text: "Callable[[RecordedMessage], str]", count: int | None) -> int:
    """Print messages as long as somebody reads them; returns how many."""
    printed = 0
    for record in records:
        printed += 1
        if not console.block(text(record)) or printed == count:
            break
    return printed
