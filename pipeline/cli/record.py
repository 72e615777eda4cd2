"""The verb record: live Zenoh keys to MCAP."""

from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pipeline.cli.options import Connect, Json, Listen, Namespace, Overwrite, Prometheus, ZenohConfig, session_config
from pipeline.terminal import console
from recorders.errors import LogError

if TYPE_CHECKING:
    from recorders.recording.config import Recording


def record(
    out: Annotated[
        Path | None,
        typer.Option(
            help="Log to write; by default session_DATE_TIME.mcap in this folder, in UTC.",
            metavar="LOG.mcap",
            show_default=False,
        ),
    ] = None,
    include: Annotated[
        list[str] | None, typer.Option(help="Pattern of topics to record, such as '/hand/*'.", metavar="PATTERN")
    ] = None,
    exclude: Annotated[
        list[str] | None, typer.Option(help="Pattern of topics to leave out.", metavar="PATTERN")
    ] = None,
    split: Annotated[
        str | None,
        typer.Option(help="Begin another file after a size or a time, such as 100MB or 10min.", metavar="SIZE|TIME"),
    ] = None,
    until_end: Annotated[
        bool, typer.Option("--until-end", help="Stop when a stream that awaits this, and all it awaits, are through.")
    ] = False,
    name: Annotated[
        str, typer.Option(help="Name by which a stream awaits this recorder.", metavar="NAME")
    ] = "recorder",
    overwrite: Overwrite = False,
    listen: Listen = None,
    connect: Connect = None,
    zenoh_config: ZenohConfig = None,
    namespace: Namespace = "reenact",
    prometheus: Prometheus = None,
    as_json: Json = False,
) -> None:
    """Record what anyone publishes over Zenoh, until Ctrl-C."""
    from pipeline.terminal.signals import until_stopped
    from recorders.messages.topics import ROBOT_DESCRIPTION
    from recorders.nodes.metrics import check_metrics
    from recorders.nodes.node import running_node
    from recorders.recording.config import RecordConfig
    from recorders.recording.live_recorder import LiveRecorder
    from recorders.text.quantities import parse_size_or_time
    from recorders.wire.receiver import Receiver, ReceiverConfig
    from recorders.wire.session import open_session

    check_metrics(prometheus)
    split_bytes, split_ns = (None, None) if split is None else parse_size_or_time(split, "--split")
    config = RecordConfig(tuple(include or ()), tuple(exclude or ()), split_bytes, split_ns)
    kept = frozenset(filter(config.wants, (ROBOT_DESCRIPTION,)))
    receiving = ReceiverConfig(name=name, namespace=namespace, live=True, kept=kept)
    session = session_config(listen, connect, zenoh_config, listens=False)
    with (
        console.counter("record") as show,
        LiveRecorder(
            out,
            config=config,
            overwrite=overwrite,
            on_progress=lambda so_far: show(so_far.messages, so_far.size),
            say=console.say,
        ) as recorder,  # first, as it refuses a name that is taken
        open_session(session) as opened,
        Receiver(opened, config=receiving, say=console.say) as receiver,
        running_node(
            opened,
            recorder.source(name),
            config=session,
            namespace=namespace,
            metrics_port=prometheus,
            report=console.say,
        ),
        until_stopped() as stopped,
    ):
        where = ", ".join(session.listen or session.connect)
        console.say(f"{name} records {namespace}/** at {where} to {recorder.out}; Ctrl-C ends it")
        recorder.run(receiver, stopped=stopped, until_end=until_end)
    console.show(recorder.recording.to_dict(), as_json=as_json)
    console.say(_outcome(recorder.recording, f"{namespace}/**"))


def _outcome(recording: "Recording", key: str) -> str:
    """Return the last line: where the recording is, or why it is empty."""
    if recording.messages:
        first, last = recording.paths[0], recording.paths[-1]
        where = str(first) if first == last else f"{len(recording.paths)} parts, {first} to {last}"
        messages = "1 message is" if recording.messages == 1 else f"{recording.messages} messages are"
        return f"{messages} recorded in {where}"
    if recording.refused:
        reasons = "; ".join(islice(recording.refused, 3))
        raise LogError(f"nothing is recorded: what came on {key} was refused: {reasons}")
    if recording.left_out:
        return f"nothing is recorded: no message that came on {key} ({recording.left_out}) is on a topic to record"
    return (
        f"nothing is recorded: nobody published on {key}, or this session may not read it; "
        "look at --namespace, the endpoint, and access control where the other end has it"
    )
