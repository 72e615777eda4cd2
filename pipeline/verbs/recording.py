"""The verb record: live Zenoh keys to MCAP."""

import re
from pathlib import Path
from typing import Annotated

import typer

from pipeline import console
from pipeline.verbs.options import Connect, Json, Listen, Namespace, Overwrite, ZenohConfig, session_config
from recorders.errors import ConfigError

_UNITS = {"s": 1.0, "min": 60.0, "h": 3600.0, "KB": 1e3, "MB": 1e6, "GB": 1e9}


def record(
    out: Annotated[Path, typer.Option(help="Log to write.")],
    include: Annotated[list[str] | None, typer.Option(help="Pattern of topics to record, such as '/hand/*'.")] = None,
    exclude: Annotated[list[str] | None, typer.Option(help="Pattern of topics to leave out.")] = None,
    split: Annotated[
        str | None, typer.Option(help="Begin another file after a size or a time, such as 100MB or 10min.")
    ] = None,
    until_end: Annotated[
        bool, typer.Option("--until-end", help="Stop at the end of a stream that awaits this.")
    ] = False,
    name: Annotated[str, typer.Option(help="Name by which a stream awaits this recorder.")] = "recorder",
    overwrite: Overwrite = False,
    listen: Listen = None,
    connect: Connect = None,
    zenoh_config: ZenohConfig = None,
    namespace: Namespace = "reenact",
    as_json: Json = False,
) -> None:
    """Record what is published over Zenoh, by whomever, until Ctrl-C."""
    from pipeline.signals import until_stopped
    from recorders.live import LiveRecorder, RecordConfig
    from recorders.wire.receiver import Receiver, ReceiverConfig
    from recorders.wire.session import open_session

    split_bytes, split_s = _parse_split(split)
    config = RecordConfig(tuple(include or ()), tuple(exclude or ()), split_bytes, split_s)
    receiving = ReceiverConfig(name=name, namespace=namespace, live=True)
    session = session_config(listen, connect, zenoh_config, listens=False)
    with (
        open_session(session) as opened,
        Receiver(opened, config=receiving, say=console.say) as receiver,
        console.counter("record") as show,
        until_stopped() as stopped,
    ):
        recorder = LiveRecorder(
            out, config=config, overwrite=overwrite, on_progress=lambda so_far: show(so_far.messages, so_far.size)
        )
        console.say(f"{name} records {namespace}/** to {out}; Ctrl-C ends it")
        recorder.run(receiver, stopped=stopped, until_end=until_end)
    console.show(recorder.recording.to_dict(), as_json=as_json)


def _parse_split(text: str | None) -> tuple[int | None, float | None]:
    if text is None:
        return None, None
    match = re.fullmatch(r"(\d+(?:\.\d+)?)(s|min|h|KB|MB|GB)", text)
    if match is None:
        raise ConfigError(f"--split: expected a size or a time, such as 100MB or 10min, found {text!r}")
    amount = float(match[1]) * _UNITS[match[2]]
    return (int(amount), None) if match[2].endswith("B") else (None, amount)
