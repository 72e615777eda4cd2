"""The verb record."""

from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pipeline.cli.groups import grouped
from pipeline.cli.options import Json, Overwrite
from pipeline.cli.ros_domain import UseSimTime, refuse_humble
from pipeline.cli.sessions import ConnectingNode
from pipeline.terminal import console
from recorders.errors import ConfigError, LogError
from recorders.text.wording import names_text

if TYPE_CHECKING:
    from recorders.recording.config import RecordConfig, RecordingStats
    from recorders.wire.receiver import ReceiverConfig


@dataclass(frozen=True)
class TopicOptions:
    """Topics that are recorded, and the size of a file."""

    include: Annotated[
        list[str] | None, typer.Option(help="Pattern of topics to record, such as '/hand/*'.", metavar="PATTERN")
    ] = None
    exclude: Annotated[list[str] | None, typer.Option(help="Pattern of topics to leave out.", metavar="PATTERN")] = None
    split: Annotated[
        str | None,
        typer.Option(help="Begin another file after a size or a time, such as 100MB or 10min.", metavar="SIZE|TIME"),
    ] = None

    def config(self) -> "RecordConfig":
        """Return the settings of the recorder."""
        from recorders.recording.config import RecordConfig
        from recorders.text.quantities import parse_size_or_time

        split_bytes, split_ns = (None, None) if self.split is None else parse_size_or_time(self.split, "--split")
        return RecordConfig(tuple(self.include or ()), tuple(self.exclude or ()), split_bytes, split_ns)


@grouped
def record(
    *,
    out: Annotated[
        Path | None,
        typer.Option(
            help="Log to write; by default session_DATE_TIME.mcap in this folder, in UTC.",
            metavar="LOG.mcap",
            show_default=False,
        ),
    ] = None,
    bag: Annotated[
        Path | None,
        typer.Option(help="New folder to record to, which `ros2 bag play` takes, in place of --out.", metavar="DIR"),
    ] = None,
    topics: TopicOptions,
    stop_at_stream_end: Annotated[
        bool,
        typer.Option(
            "--stop-at-stream-end", help="Stop when a stream that awaits this, and all it awaits, are through."
        ),
    ] = False,
    name: Annotated[
        str, typer.Option(help="Name by which a stream awaits this recorder.", metavar="NAME")
    ] = "recorder",
    overwrite: Overwrite = False,
    use_sim_time: UseSimTime = False,
    node: ConnectingNode,
    as_json: Json = False,
) -> None:
    """Record what anyone publishes over Zenoh, until Ctrl-C."""
    from recorders.nodes.metrics import check_metrics
    from recorders.recording.bag_folder import new_bag_folder
    from recorders.wire.keys.topic_keys import EVERY_TOPIC
    from recorders.writing.part_file import check_place

    check_metrics(node.prometheus)
    refuse_humble("record", given=node.humble)
    config = replace(topics.config(), for_rosbag2=bag is not None, use_sim_time=use_sim_time)
    if bag is not None:
        if out is not None or overwrite:
            raise ConfigError("--bag: expected a new folder and neither --out nor --overwrite")
        out = new_bag_folder(bag)
    if out is not None and config.split_bytes is None and config.split_ns is None:
        check_place(out, overwrite=overwrite)  # before anybody is waited for
    try:
        recording = _record(out, name, config, node, overwrite=overwrite, stop_at_stream_end=stop_at_stream_end)
    except BaseException:
        with suppress(OSError):  # it holds what was recorded
            if bag is not None:
                bag.rmdir()
        raise
    result = recording.to_dict() if as_json else recording.totals()
    for name in ("left_out", "of_streams", "silent"):
        if not (as_json or result[name]):
            del result[name]
    console.show(result, as_json=as_json)
    console.notice(_outcome(recording, node.keys(name).described(EVERY_TOPIC)))
    if recording.silent:
        silent = names_text(recording.silent)
        console.notice(f"no message came of {silent}: their publishers published nothing so far")


def _record(
    out: Path | None,
    name: str,
    config: "RecordConfig",
    node: ConnectingNode,
    *,
    overwrite: bool,
    stop_at_stream_end: bool,
) -> "RecordingStats":
    """Record until it is over, and return what there is of it."""
    from pipeline.terminal.signals import until_stopped
    from recorders.nodes.node import running_node
    from recorders.recording.bag_folder import write_bag_metadata
    from recorders.recording.live_recorder import LiveRecorder
    from recorders.recording.ros_channels import domain_channels
    from recorders.recording.ros_subscriptions import recorded_topics
    from recorders.wire.keys.topic_keys import EVERY_TOPIC
    from recorders.wire.receiver import Receiver
    from recorders.wire.session import open_session

    receiving = _receiving(name, node, config)
    session = node.config()
    what = receiving.keys.described(EVERY_TOPIC)
    where = ", ".join(session.listen or session.connect)
    with (
        console.counter("record") as show,
        open_session(session, on_wait=partial(console.notice, f"{name} waits for {where}, to record {what}")) as opened,
        receiving.keys.joined(opened),
        domain_channels(opened, receiving.keys) as channels,
        Receiver(opened, config=receiving) as receiver,
        LiveRecorder(  # last, as it sets aside what a crash left: only a recording that begins may do that
            out,
            config=config,
            overwrite=overwrite,
            on_progress=lambda so_far: show(so_far.messages, so_far.size),
            ros=channels,
        ) as recorder,
        until_stopped() as stopped,  # before anybody sees that this is there, and may stop it
        running_node(
            opened,
            recorder.source(name),
            config=session,
            namespace=node.namespace,
            metrics_port=node.prometheus,
        ),
        recorded_topics(opened, receiving.keys, channels, config.wants) as published,
    ):
        console.notice(f"{name} records {what} at {where} to {recorder.out}; Ctrl-C ends it")
        try:
            recorder.run(receiver, stopped=stopped, stop_at_stream_end=stop_at_stream_end)
            recorder.recording.note_published(published)
        finally:
            if config.for_rosbag2 and all(path.is_file() for path in recorder.recording.paths):
                write_bag_metadata(recorder.recording.paths)
    return recorder.recording


def _receiving(name: str, node: ConnectingNode, config: "RecordConfig") -> "ReceiverConfig":
    from recorders.messages.topics import ROBOT_TEXTS
    from recorders.wire.keys.topic_keys import EVERY_TOPIC
    from recorders.wire.receiver import ReceiverConfig

    in_ros = node.ros is not None  # where publishers state themselves which topics are latched
    latched = frozenset((EVERY_TOPIC,)) if in_ros else frozenset(filter(config.wants, ROBOT_TEXTS.values()))
    return ReceiverConfig(name=name, keys=node.keys(name), live=True, latched_topics=latched, key_file=node.key)


def _outcome(recording: "RecordingStats", where: str) -> str:
    """Return the last line: where the recording is, or why it is empty."""
    if recording.messages:
        first, last = recording.paths[0], recording.paths[-1]
        place = str(first) if first == last else f"{len(recording.paths)} parts, {first} to {last}"
        messages = "1 message is" if recording.messages == 1 else f"{recording.messages} messages are"
        streamed = f", {recording.of_streams} of a stream that awaited this" if recording.of_streams else ""
        return f"{messages} recorded in {place}{streamed}"
    if recording.refused:
        reasons = "; ".join(islice(recording.refused, 3))
        raise LogError(f"nothing is recorded: what came on {where} was refused: {reasons}")
    if recording.left_out:
        return f"nothing is recorded: no message that came on {where} ({recording.left_out}) is on a topic to record"
    return (
        f"nothing is recorded: nobody published on {where}, or this session may not read it; "
        "look at --namespace, the endpoint, and access control where the other end has it"
    )
