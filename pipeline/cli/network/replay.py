"""The verb replay."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pipeline.cli.alignment import AlignmentOptions
from pipeline.cli.groups import grouped
from pipeline.cli.network.ros_playing import RosPlayOptions
from pipeline.cli.options import AsRecorded, Json, Logs, StreamsRobot
from pipeline.cli.project_settings import of_settings
from pipeline.cli.sessions import ConnectingNode, Wait
from pipeline.terminal import console
from recorders.errors import ConfigError

if TYPE_CHECKING:
    from recorders.containers.reader import Opened
    from replay.sources.playback import Playback
    from replay.transports.sender_config import SenderConfig
    from replay.transports.transport import Source


_SPECTATORS = "nobody is awaited: whoever listens may lose messages"
_SUBSCRIBERS = "nobody acknowledges: whoever subscribes may lose messages"


Awaited = Annotated[
    list[str] | None,
    typer.Option(
        "--await",
        help="Consumer to feed and wait for; learner, unless --play plays to whoever listens.",
        metavar="NAME",
    ),
]


@dataclass(frozen=True)
class ScheduleOptions:
    """Presentation of the logs to a learner."""

    epochs: Annotated[
        int | None,
        typer.Option(
            help="Epochs to present the logs for: as many as the rule takes (reservoir: 150), or as recorded.",
            min=1,
            metavar="N",
        ),
    ] = None
    rule: Annotated[
        str | None,
        typer.Option("--rule", help="Rule that is to learn them: reservoir if left out.", metavar="RULE"),
    ] = None
    as_recorded: AsRecorded = False
    pairs: Annotated[
        str | None,
        typer.Option(help="Pairs that the learner is to learn from: the rule's, or as recorded.", metavar="PAIRS"),
    ] = None


@dataclass(frozen=True)
class PlayOptions:
    """Part of the logs that is played once."""

    play: Annotated[bool, typer.Option("--play", help="Play every topic once, in place of a training schedule.")] = (
        False
    )
    loop: Annotated[int, typer.Option(help="With --play: how often; 0 for ever.", min=0, metavar="N")] = 1
    start: Annotated[
        str | None, typer.Option(help="With --play: start so long after the first message.", metavar="SECONDS")
    ] = None
    end: Annotated[
        str | None, typer.Option(help="With --play: end so long after the first message.", metavar="SECONDS")
    ] = None
    topic: Annotated[
        list[str] | None,
        typer.Option(
            help="With --play: pattern of topics to play, such as '/hand/*'; all if left out.", metavar="PATTERN"
        ),
    ] = None

    @property
    def has_more(self) -> bool:
        """True if anything is set that needs --play."""
        return bool(self.topic) or self.loop != 1 or self.start is not None or self.end is not None


@dataclass(frozen=True)
class SendOptions:
    """Messages under way, and messages in one payload."""

    window: Annotated[int, typer.Option(help="Messages under way unacknowledged.", min=1, metavar="N")] = 1024
    batch_size: Annotated[
        int | None,
        typer.Option(help="Messages in one payload: 64, or 1 when paced, or played with --ros.", min=1, metavar="N"),
    ] = None

    def config(
        self, consumers: tuple[str, ...], node: ConnectingNode, *, plays: bool, paced: bool, wait_s: float
    ) -> "SenderConfig":
        """Return the settings of the sender; raises ConfigError for batches that are played to nodes of ROS."""
        from replay.transports.sender_config import SenderConfig

        to_ros = plays and node.ros is not None
        if to_ros and (self.batch_size or 1) > 1:
            raise ConfigError(
                "--batch-size: expected 1 with --ros and --play, as nodes of ROS know no batches, "
                f"found {self.batch_size}"
            )
        singly = paced or to_ros
        batch_size = self.batch_size or min(64 if consumers and not singly else 1, self.window)
        return SenderConfig(
            consumers,
            keys=node.keys("replay"),
            window=self.window,
            batch_size=batch_size,
            wait_s=wait_s,
            key_file=node.key,
        )


@grouped
def replay(
    logs: Logs,
    *,
    awaited: Awaited = None,
    schedule: ScheduleOptions,
    rate: Annotated[
        float | None, typer.Option(help="Pace: 1 is real time; from 0.1 to 1000.", metavar="FACTOR")
    ] = None,
    playing: PlayOptions,
    in_domain: RosPlayOptions,
    robot: StreamsRobot = None,
    alignment: AlignmentOptions,
    compare_with: Annotated[
        Path | None,
        typer.Option(help="Recorded run to compare with; stops where they part.", metavar="LOG.mcap"),
    ] = None,
    sending: SendOptions,
    wait: Wait = 10.0,
    node: ConnectingNode,
    as_json: Json = False,
) -> None:
    """Replay logs over Zenoh, into learners or to whoever listens.

    Learners get them as fast as they acknowledge; a paced replay goes out on the original keys. On a terminal, the
    space bar stops and starts a paced replay, and a full stop lets one message pass.
    """
    from pipeline.learner_node.replay_node import replay as run
    from pipeline.terminal.replay_controls import VerifiedSource, keyboard
    from recorders.nodes.metrics import check_metrics
    from replay.transports.clock import Paced, Pausable, Unpaced

    check_metrics(node.prometheus)
    period_ns = in_domain.clock_period_ns(plays=playing.play, paced=rate is not None)
    source = (
        _played(logs, schedule, playing, alignment, latched_first=node.ros is not None, clock_period_ns=period_ns)
        if playing.play
        else _presented(logs, schedule, playing, robot, alignment)
    )
    consumers = tuple(awaited or (() if playing.play else ("learner",)))
    sender = sending.config(consumers, node, plays=playing.play, paced=rate is not None, wait_s=wait)
    sender, channels = in_domain.applied(sender, source)
    if compare_with is not None:
        source = VerifiedSource(source, compare_with, everything=playing.play)
    pace = Unpaced() if rate is None else Paced(rate)
    if not consumers:
        console.notice(_SUBSCRIBERS if sender.wait_for else _SPECTATORS)
    session, clock = node.config(wait_s=wait), Pausable(pace)
    with console.progress("replay") as advance, keyboard(clock, enabled=rate is not None):
        result = run(
            source,
            session=session,
            sender=sender,
            clock=clock if rate is not None else pace,
            metrics_port=node.prometheus,
            channels=channels,
            on_progress=advance,
        )
    if isinstance(pace, Paced):
        result["slipped_s"] = round(pace.slipped_s, 3)
    console.show(result, as_json=as_json)


def _played(
    logs: list[Path],
    schedule: ScheduleOptions,
    playing: PlayOptions,
    alignment: AlignmentOptions,
    *,
    latched_first: bool,
    clock_period_ns: int | None,
) -> "Playback":
    from recorders.reading.parts import recordings
    from recorders.text.quantities import parse_seconds
    from replay.sources.playback import Playback, PlaybackConfig

    found = recordings(logs)
    alignment.refuse("--play")
    of_learning = {
        "as-recorded": schedule.as_recorded,
        "epochs": schedule.epochs,
        "rule": schedule.rule,
        "pairs": schedule.pairs,
    }
    if any(value and not of_settings(name) for name, value in of_learning.items()):
        raise ConfigError("--play: expected none of --as-recorded, --epochs, --rule and --pairs beside it")
    config = PlaybackConfig(
        frozenset(playing.topic or ()),
        renames=alignment.of_logs(found).renames,
        start_ns=0 if playing.start is None else parse_seconds(playing.start, "--start"),
        end_ns=None if playing.end is None else parse_seconds(playing.end, "--end"),
        loops=playing.loop,
        latched_first=latched_first,
        clock_period_ns=clock_period_ns,
    )
    return Playback(found, config)


def _presented(
    logs: list[Path],
    schedule: ScheduleOptions,
    playing: PlayOptions,
    robot: str | None,
    alignment: AlignmentOptions,
) -> "Source":
    from pipeline.learner.registry import default_config
    from pipeline.robot.config import load_robot
    from pipeline.robot.recorded import recorded_hands, with_robot
    from pipeline.samples.pairing import find_pairing
    from pipeline.training.pairing_choice import pairing_for, pairing_of
    from recorders.reading.parts import one_session, recordings
    from replay.sources.scheduled import Replay
    from replay.sources.session import RecordedSession

    config = None if robot is None else load_robot(robot)
    if playing.has_more:
        raise ConfigError("--topic, --loop, --start and --end: expected --play beside them")
    if schedule.as_recorded:
        alignment.refuse("--as-recorded")
        log = one_session(logs)
        names: Mapping[str, str] = alignment.of_logs([log]).renames
        hands = recorded_hands(log, robot=config, renames=names)
        topics = None
        if schedule.pairs is not None:
            asked = find_pairing(schedule.pairs)
            topics = pairing_for(asked, [log], robot=config, renames=names, as_recorded=True).topics(hands)
        return RecordedSession(with_robot(log, config), epochs=schedule.epochs, renames=names, topics=topics)
    found: Sequence[Opened] = recordings(logs)
    learner = default_config(schedule.rule)
    asked = pairing_of(learner, schedule.pairs)
    alignment = alignment.of_logs(found)
    hands = recorded_hands(found[0], robot=config, renames=alignment.renames)
    found, names = alignment.align(found, robot=config, tick=asked.topics(hands))
    topics = pairing_for(asked, found, robot=config, renames=names).topics(hands)
    presented = [with_robot(log, config) for log in found]
    return Replay(presented, learner.schedule(schedule.epochs, topics), renames=names)
