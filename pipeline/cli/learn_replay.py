"""The verbs that speak Zenoh: learn and replay."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pipeline.cli.interrupts import leaving
from pipeline.cli.options import (
    AsRecorded,
    Connect,
    ConnectInstead,
    Json,
    Listen,
    ListenFirst,
    Logs,
    Namespace,
    Overwrite,
    Prometheus,
    Renames,
    Seed,
    StreamsRobot,
    Wait,
    ZenohConfig,
    renames,
    session_config,
)
from pipeline.cli.view import View, Viewer, learner_shown
from pipeline.terminal import console
from recorders.errors import ConfigError, ReenactError

if TYPE_CHECKING:
    from replay.transports.transport import Source

_SPECTATORS = "nobody is awaited: whoever listens may lose messages"


def learn(
    out: Annotated[Path, typer.Option(help="Controller to write when the stream ends.", metavar="CONTROLLER.npz")],
    name: Annotated[str, typer.Option(help="Name by which a replay awaits this learner.", metavar="NAME")] = "learner",
    robot: StreamsRobot = None,
    seed: Seed = 0,
    checkpoint: Annotated[
        Path | None,
        typer.Option(help="File to keep the learner in on the way, and to go on from.", metavar="CHECKPOINT.npz"),
    ] = None,
    every: Annotated[int, typer.Option(help="Ticks between two checkpoints.", min=1, metavar="N")] = 10_000,
    live: Annotated[
        bool, typer.Option("--live", help="Learn from whoever publishes targets and joints, until Ctrl-C.")
    ] = False,
    ticks: Annotated[int | None, typer.Option(help="With --live: end after so many.", min=1, metavar="N")] = None,
    epochs: Annotated[
        int | None,
        typer.Option(help="With --live: epochs that phase markers may name; 1 if left out.", min=1, metavar="N"),
    ] = None,
    record: Annotated[
        Path | None,
        typer.Option(
            help="With --live: log to write, of what is learned from; train it --as-recorded.", metavar="LOG.mcap"
        ),
    ] = None,
    listen: ListenFirst = None,
    connect: ConnectInstead = None,
    zenoh_config: ZenohConfig = None,
    namespace: Namespace = "reenact",
    prometheus: Prometheus = None,
    overwrite: Overwrite = False,
    view: View = False,
    viewer: Viewer = None,
    as_json: Json = False,
) -> None:
    """Learn online over Zenoh, from a replay or a live session.

    The learner hears a session or replay that awaits it by name, to its end, or with --live whoever publishes. With
    --live, what cannot be used is refused and changes nothing, and the result counts it. The learner also
    ends with a stream that awaits it by name.
    """
    from pipeline.learner.controller import check_writable
    from pipeline.learner.rules.reservoir.config import LearnerConfig
    from pipeline.learner_node.live_learner import LiveConfig
    from pipeline.learner_node.live_node import learn_live
    from pipeline.learner_node.node import OWN_TOPICS
    from pipeline.learner_node.node import learn as run
    from pipeline.robot.config import load_robot
    from pipeline.terminal.learning_progress import learning_progress
    from pipeline.training.checkpoints import CheckpointConfig, find_checkpoint
    from recorders.nodes.metrics import check_metrics
    from recorders.wire.receiver import ReceiverConfig
    from recorders.writing.part_file import check_place

    if not live and (ticks is not None or epochs is not None or record is not None):
        raise ConfigError("--ticks, --epochs and --record: expected --live beside them")
    check_metrics(prometheus)
    check_writable(out, overwrite=overwrite or out == checkpoint)
    if checkpoint is not None:
        check_writable(checkpoint)
        find_checkpoint(checkpoint)
    if record is not None:
        check_place(record, overwrite=overwrite)
    receiver = ReceiverConfig(name=name, namespace=namespace, live=live, own_topics=OWN_TOPICS)
    config = None if robot is None else load_robot(robot)
    session = session_config(listen, connect, zenoh_config, listens=True)
    with (
        leaving(lambda: _kept(checkpoint)),
        learning_progress("learn") as show,
        learner_shown(view, viewer, live=live) as make_trainer,
    ):
        trainer = make_trainer(
            LearnerConfig(seed=seed),
            robot=config,
            checkpoint=None if checkpoint is None else CheckpointConfig(checkpoint, every),
            on_progress=show,
        )
        if live:
            lasting = LiveConfig(epochs=epochs or 1, ticks=ticks, record=record, overwrite=overwrite)
            result = learn_live(
                trainer,
                robot=config,
                session=session,
                receiver=receiver,
                config=lasting,
                metrics_port=prometheus,
                say=console.say,
            )
        else:
            result = run(trainer, session=session, receiver=receiver, metrics_port=prometheus, say=console.say)
    trainer.check_learned()
    trainer.controller().save(out)
    console.show(result | {"controller": str(out)}, as_json=as_json)


def _kept(checkpoint: Path | None) -> str:
    from pipeline.training.checkpoints import find_checkpoint

    try:
        kept = None if checkpoint is None else find_checkpoint(checkpoint)
    except ReenactError:
        kept = None  # something else, which was there before or is cut off
    if kept is None:
        return "no controller was written"
    return f"no controller was written; {checkpoint} keeps the learner, for the same command to go on from"


def replay(
    logs: Logs,
    awaited: Annotated[
        list[str] | None,
        typer.Option(
            "--await",
            help="Consumer to feed and wait for; learner, unless --play plays to whoever listens.",
            metavar="NAME",
        ),
    ] = None,
    epochs: Annotated[
        int | None, typer.Option(help="Epochs to present the logs for: 150, or as recorded.", min=1, metavar="N")
    ] = None,
    as_recorded: AsRecorded = False,
    rate: Annotated[
        float | None, typer.Option(help="Pace: 1 is real time; from 0.1 to 1000.", metavar="FACTOR")
    ] = None,
    play: Annotated[
        bool, typer.Option("--play", help="Play every topic once, in place of a training schedule.")
    ] = False,
    loop: Annotated[int, typer.Option(help="With --play: how often; 0 for ever.", min=0, metavar="N")] = 1,
    start: Annotated[
        str | None, typer.Option(help="With --play: start so long after the first message.", metavar="SECONDS")
    ] = None,
    end: Annotated[
        str | None, typer.Option(help="With --play: end so long after the first message.", metavar="SECONDS")
    ] = None,
    topic: Annotated[
        list[str] | None,
        typer.Option(
            help="With --play: pattern of topics to play, such as '/hand/*'; all if left out.", metavar="PATTERN"
        ),
    ] = None,
    map_: Renames = None,
    against: Annotated[
        Path | None,
        typer.Option(help="Recorded run to compare with; stops where they part.", metavar="LOG.mcap"),
    ] = None,
    window: Annotated[int, typer.Option(help="Messages under way unacknowledged.", min=1, metavar="N")] = 1024,
    batch: Annotated[
        int | None, typer.Option(help="Messages in one payload: 64, or 1 when paced.", min=1, metavar="N")
    ] = None,
    wait: Wait = 10.0,
    listen: Listen = None,
    connect: Connect = None,
    zenoh_config: ZenohConfig = None,
    namespace: Namespace = "reenact",
    prometheus: Prometheus = None,
    as_json: Json = False,
) -> None:
    """Replay logs over Zenoh, into learners or to whoever listens.

    Learners get them as fast as they acknowledge; a paced replay goes out on the original keys. On a terminal, the
    space bar stops and starts a paced replay, and a full stop lets one message pass.
    """
    from pipeline.learner_node.node import replay as run
    from pipeline.terminal.replay_controls import Guarded, keyboard
    from recorders.nodes.metrics import check_metrics
    from replay.sources.playback import Playback
    from replay.transports.clock import Paced, Pausable, Unpaced
    from replay.transports.sender_config import SenderConfig

    check_metrics(prometheus)
    source = _source(logs, epochs, as_recorded, play, renames(map_), loop, start, end, topic)
    channels = source.channels if isinstance(source, Playback) else ()
    if against is not None:
        source = Guarded(source, against, everything=play)
    consumers = tuple(awaited or (() if play else ("learner",)))
    sender = SenderConfig(
        consumers=consumers,
        namespace=namespace,
        window=window,
        batch=batch or min(64 if rate is None and consumers else 1, window),
        wait_s=wait,
    )
    pace = Unpaced() if rate is None else Paced(rate, say=console.say)
    session = session_config(listen, connect, zenoh_config, listens=False, wait_s=wait)
    if not consumers:
        console.say(_SPECTATORS)
    clock = Pausable(pace)
    with console.progress("replay") as advance, keyboard(clock, enabled=rate is not None):
        result = run(
            source,
            session=session,
            sender=sender,
            clock=clock if rate is not None else pace,
            metrics_port=prometheus,
            channels=channels,
            on_progress=advance,
            say=console.say,
        )
    if isinstance(pace, Paced):
        result["slipped_s"] = round(pace.slipped_s, 3)
    console.show(result, as_json=as_json)


def _source(
    logs: list[Path],
    epochs: int | None,
    as_recorded: bool,
    play: bool,
    names: dict[str, str],
    loop: int,
    start: str | None,
    end: str | None,
    topics: list[str] | None,
) -> "Source":
    from recorders.reading.parts import one_session, recordings
    from recorders.text.quantities import parse_seconds
    from replay.sources.playback import Playback, PlaybackConfig
    from replay.sources.schedule import Schedule
    from replay.sources.scheduled import Replay
    from replay.sources.session import RecordedSession

    if play and (as_recorded or epochs is not None):
        raise ConfigError("--play: expected neither --as-recorded nor --epochs beside it")
    if play:
        start_ns = 0 if start is None else parse_seconds(start, "--start")
        end_ns = None if end is None else parse_seconds(end, "--end")
        topics_played = frozenset(topics or ())
        chosen = PlaybackConfig(topics_played, renames=names, start_ns=start_ns, end_ns=end_ns, loops=loop)
        return Playback(recordings(logs, console.say), chosen)
    if topics or loop != 1 or start is not None or end is not None:
        raise ConfigError("--topic, --loop, --start and --end: expected --play beside them")
    if as_recorded:
        return RecordedSession(one_session(logs, console.say), epochs=epochs, renames=names)
    return Replay(recordings(logs, console.say), Schedule(epochs=epochs or 150), renames=names)
