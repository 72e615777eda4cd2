"""The verb learn."""

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pipeline.cli.alignment import AlignmentOptions
from pipeline.cli.groups import grouped
from pipeline.cli.interrupts import note_on_interrupt
from pipeline.cli.options import Json, LearnerFile, Overwrite, Pairs, Rule, Seed, StreamsRobot, learner_settings
from pipeline.cli.ros_domain import UseSimTime
from pipeline.cli.sessions import StreamingNode
from pipeline.cli.viewers import ViewOptions
from pipeline.terminal import console
from recorders.errors import ConfigError, ReenactError

if TYPE_CHECKING:
    from pipeline.learner_node.live_learner import LiveConfig
    from pipeline.training.checkpoints import CheckpointConfig
    from recorders.wire.receiver import ReceiverConfig


@dataclass(frozen=True)
class CheckpointOptions:
    """File of the learner on the way."""

    checkpoint: Annotated[
        Path | None,
        typer.Option(help="File to keep the learner in on the way, and to go on from.", metavar="CHECKPOINT.npz"),
    ] = None
    checkpoint_every: Annotated[int, typer.Option(help="Ticks between two checkpoints.", min=1, metavar="N")] = 10_000

    def config(self) -> "CheckpointConfig | None":
        """Return the settings, None without checkpoints."""
        from pipeline.training.checkpoints import CheckpointConfig

        return None if self.checkpoint is None else CheckpointConfig(self.checkpoint, self.checkpoint_every)

    def note(self) -> str:
        """Return the line for a learner that was cut short."""
        from pipeline.training.checkpoints import find_checkpoint

        try:
            found = None if self.checkpoint is None else find_checkpoint(self.checkpoint)
        except ReenactError:
            found = None  # something else, which was there before or is cut off
        if found is None:
            return "no controller was written"
        return f"no controller was written; {self.checkpoint} keeps the learner, for the same command to go on from"


@dataclass(frozen=True)
class LiveOptions:
    """Learning from a session that awaits no learner."""

    live: Annotated[
        bool, typer.Option("--live", help="Learn from whoever publishes targets and joints, until Ctrl-C.")
    ] = False
    ticks: Annotated[int | None, typer.Option(help="With --live: end after so many.", min=1, metavar="N")] = None
    epochs: Annotated[
        int | None,
        typer.Option(help="With --live: epochs that phase markers may name; 1 if left out.", min=1, metavar="N"),
    ] = None
    record: Annotated[
        Path | None,
        typer.Option(
            help="With --live: log to write, of what is learned from; train it --as-recorded.", metavar="LOG.mcap"
        ),
    ] = None

    use_sim_time: UseSimTime = False

    def check(self) -> None:
        """Raise ConfigError if anything is set that needs --live, without it."""
        if not self.live and (self.ticks is not None or self.epochs is not None or self.record is not None):
            raise ConfigError("--ticks, --epochs and --record: expected --live beside them")
        if self.use_sim_time and not self.live:
            raise ConfigError("--use-sim-time: expected --live beside it: a stream that awaits this has its own times")

    def receiver(self, name: str, node: StreamingNode, own: frozenset[str]) -> "ReceiverConfig":
        """Return the settings of a receiver of a name, with its own topics."""
        from recorders.wire.receiver import ReceiverConfig

        return ReceiverConfig(
            name=name,
            keys=node.keys(name),
            live=self.live,
            extra_topics=own,
            key_file=node.key,
            use_sim_time=self.use_sim_time,
        )

    def config(self, alignment: AlignmentOptions, *, overwrite: bool) -> "LiveConfig":
        """Return the settings of live learning."""
        from pipeline.learner_node.live_learner import LiveConfig

        return LiveConfig(
            epochs=self.epochs or 1,
            ticks=self.ticks,
            record=self.record,
            overwrite=overwrite,
            alignment=alignment.live_config(),
            renames=alignment.renames,
        )


@grouped
def learn(
    *,
    out: Annotated[Path, typer.Option(help="Controller to write when the stream ends.", metavar="CONTROLLER.npz")],
    name: Annotated[str, typer.Option(help="Name by which a replay awaits this learner.", metavar="NAME")] = "learner",
    robot: StreamsRobot = None,
    seed: Seed = 0,
    rule: Rule = None,
    pairs: Pairs = None,
    settings: LearnerFile = None,
    checkpoints: CheckpointOptions,
    live: LiveOptions,
    alignment: AlignmentOptions,
    node: StreamingNode,
    overwrite: Overwrite = False,
    viewer: ViewOptions,
    as_json: Json = False,
) -> None:
    """Learn online over Zenoh, from a replay or a live session.

    The learner receives a session or replay that awaits it by name, to its end, or with --live whoever publishes. With
    --live, what cannot be used is refused and changes nothing, and the result counts it. The learner also
    ends with a stream that awaits it by name.
    """
    from pipeline.learner_node.live_node import learn_live
    from pipeline.learner_node.node import learn as run
    from pipeline.learner_node.node import own_topics
    from pipeline.robot.config import load_robot
    from pipeline.terminal.learning_progress import learning_progress
    from pipeline.terminal.training_lines import training_lines
    from pipeline.training.pairing_choice import pairing_of
    from recorders.nodes.metrics import check_metrics

    live.check()
    if not live.live:
        alignment.refuse("learn without --live, whose replay aligns", renames=True)
    check_metrics(node.prometheus)
    _check_files(out, checkpoints.checkpoint, live.record, overwrite=overwrite)
    learner, pairs = learner_settings(settings, rule, pairs, seed)
    config = None if robot is None else load_robot(robot)
    own = own_topics(pairing_of(learner, pairs), config)
    receiver = live.receiver(name, node, own)
    session = node.config()
    with (
        note_on_interrupt(checkpoints.note),
        learning_progress("learn") as show,
        viewer.trainer(live=live.live) as make_trainer,
    ):
        trainer = make_trainer(learner, robot=config, pairs=pairs, checkpoint=checkpoints.config(), on_progress=show)
        live_config = live.config(alignment, overwrite=overwrite)
        learn_from = partial(learn_live, robot=config, config=live_config) if live.live else run
        result = learn_from(trainer, session=session, receiver=receiver, metrics_port=node.prometheus)
    trainer.check_learned()
    controller = trainer.controller()
    controller.save(out)
    result = result if as_json else training_lines(result, trainer.cycles)
    console.show(result | {"pairs": controller.pairs, "controller": str(out)}, as_json=as_json)


def _check_files(out: Path, checkpoint: Path | None, record: Path | None, *, overwrite: bool) -> None:
    from pipeline.learner.controller import check_writable
    from pipeline.training.checkpoints import find_checkpoint
    from recorders.writing.part_file import check_place

    check_writable(out, overwrite=overwrite or out == checkpoint)
    if checkpoint is not None:
        check_writable(checkpoint)
        find_checkpoint(checkpoint)
    if record is not None:
        check_place(record, overwrite=overwrite)
