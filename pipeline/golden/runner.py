"""Runs golden cases: the learner step by step under observation, and as programs run it."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from pipeline.evaluation.errors import HandErrors
from pipeline.evaluation.trials import evaluate_samples
from pipeline.extras import missing_extra
from pipeline.golden import states as golden_states
from pipeline.golden.observer import ObservedRun
from pipeline.golden.own_settings import pairs_of, read_settings, with_pairs, with_pairs_for, without_pairs
from pipeline.learner.controller import Controller
from pipeline.learner.rule import Settings
from pipeline.learner.state import state_numbers
from pipeline.robot.recorded import recorded_hands, require_recorded_robot
from pipeline.robot.resolution import UNLIMITED
from pipeline.samples.pairing import COMMANDED, PairingRule, find_pairing
from pipeline.samples.pairs import read_samples
from pipeline.training.checkpoints import CheckpointConfig
from pipeline.training.run import CycleReport
from pipeline.training.trainer import Trainer
from recorders.errors import ConfigError
from recorders.messages.message_types import Message
from recorders.messages.record import RecordedMessage
from recorders.reading.reader import LogReader
from recorders.text.wording import names_text
from replay.golden.recipe import MAX_CASE_BYTES, CaseSpec, EpochEnd, State, TickDigests
from replay.sources.schedule import Schedule
from replay.sources.session import RecordedSession

_EPOCHS = 2  # of a case, by default


class GoldenRunner:
    """The runner of `replay.golden.check` for this learner and these robots.

    A case is run twice. Once step by step, with a digest of stream, outputs and state after every tick; and once as
    programs do it, in pieces, by the same `Trainer` that `train` and `learn` use.
    """

    def learn(self, recipe: CaseSpec) -> Iterator[TickDigests | EpochEnd]:
        """Run step by step, and yield every tick and the end of every epoch."""
        source = recipe.source()
        pairing = find_pairing(_pairs(recipe))
        yield from ObservedRun(_config(recipe), pairing, source.offer(), recipe.resume_after).run(source.stream())

    def train(self, recipe: CaseSpec) -> dict[str, Any]:
        """Run as programs do, and return digests, counts, the errors [cm] of all evaluated cycles and of trials."""
        cycles: list[CycleReport] = []
        trainer = _trained(recipe, on_cycle=cycles.append)
        trainer.check_learned()
        controller = trainer.controller()
        trials = [] if recipe.as_recorded else [_trial(controller, path, _pairs(recipe)) for path in recipe.logs]
        return {
            **trainer.result(),
            "errors_cm": trainer.errors_cm,
            "hands_cm": [list(cycle.hands_cm) for cycle in cycles if cycle.hands_cm is not None],
            "trials_cm": [errors.mean_cm for errors in trials],
            "trials_hands_cm": [list(errors.hands_cm.values()) for errors in trials],
        }

    def simulate(self, log: Path, *, ticks: int) -> Iterator[tuple[str, Message]]:
        """Yield topic and message of the first ticks that teacher and simulation make of a log's recipe now.

        Raises
        ------
        MissingExtra
            If Drake is not installed.
        """
        try:
            from pipeline.exploration.reproduce import simulate  # noqa: PLC0415  # Drake: most cases do without
        except ModuleNotFoundError as error:
            raise missing_extra(error) or error from None
        return simulate(log, ticks=ticks)

    def changed_robot(self, log: Path) -> str:
        """Return how the robot that comes with the program differs from the log's; the empty string if it does not."""
        from pipeline.exploration.reproduce import changed_robot  # noqa: PLC0415

        return changed_robot(log)

    def physics_tolerance(self, log: Path) -> float | None:
        """Return 0 if the sensors of a log's robot had a resolution, more if a solver led it; None without either."""
        from pipeline.exploration.reproduce import leader_spread  # noqa: PLC0415

        reader = LogReader(log)
        if spread := leader_spread(reader.manifest):
            return spread
        return None if require_recorded_robot(reader).resolution == UNLIMITED else 0.0

    def pack(self, states: Sequence[State]) -> bytes:
        """Return the states at the ends of the epochs as the bytes of an .npz."""
        return golden_states.pack(states)

    def difference(self, packed: bytes, end: EpochEnd) -> tuple[str, str, str] | None:
        """Name the first element that differs from what was packed: name, expected, found."""
        return golden_states.difference(packed, end)


def _pairs(recipe: CaseSpec) -> str:
    """Return the name of the pairing rule of a case; raises ConfigError if its ticks are not those of the rule."""
    pairing = find_pairing(pairs_of(recipe.learner))
    topics = pairing.topics(recorded_hands(recipe.logs[0]))
    if topics != recipe.schedule.topics:
        raise ConfigError(
            f"golden case: expected ticks of {names_text(topics)} for pairs {pairing.name}, found those of "
            f"{names_text(recipe.schedule.topics)}"
        )
    return pairing.name


def _config(recipe: CaseSpec) -> Settings:
    config = without_pairs(recipe.learner)
    size = 8 * state_numbers(config.state_shapes())
    if size > MAX_CASE_BYTES:
        raise ConfigError(
            f"golden case: expected a learner whose state takes at most {MAX_CASE_BYTES} bytes, found {size}"
        )
    return config


def _trained(recipe: CaseSpec, *, on_cycle: Callable[[CycleReport], None]) -> Trainer:
    """Train, by way of a checkpoint if the case has one; cycles are reported from there on."""
    source = recipe.source()
    if recipe.resume_after is None:
        trainer = Trainer(_config(recipe), pairs=_pairs(recipe), on_cycle=on_cycle)
        trainer.consume(source.stream(trainer.hello(source.offer())))
        return trainer
    with TemporaryDirectory() as folder:
        checkpoint = CheckpointConfig(Path(folder, "checkpoint.npz"), recipe.resume_after)
        stopped = Trainer(_config(recipe), pairs=_pairs(recipe), checkpoint=checkpoint)
        stopped.hello(source.offer())
        stopped.take(_until_checkpoint(source.stream(), checkpoint.path))
        trainer = Trainer(_config(recipe), pairs=_pairs(recipe), checkpoint=checkpoint, on_cycle=on_cycle)
        trainer.consume(source.stream(trainer.hello(source.offer())))
    return trainer


def _until_checkpoint(messages: Iterator[RecordedMessage], path: Path) -> Iterator[RecordedMessage]:
    """Yield messages until there is a checkpoint."""
    for message in messages:
        yield message
        if path.exists():
            return


def _trial(controller: Controller, log: Path, pairs: str) -> HandErrors:
    """Try a controller on a log, after the washout that every test begins with."""
    return evaluate_samples(controller, read_samples(log, pairs=pairs), name=log.name).errors


def asked_pairing(
    config: Path | None, old: CaseSpec | None, *, rule: str | None = None, pairs: str | None = None
) -> PairingRule:
    """Return the pairing rule that a case is to follow; raises ConfigError as `recipe` does of its settings."""
    if config is None and rule is None:
        return find_pairing(pairs or (COMMANDED if old is None else pairs_of(old.learner)))
    return find_pairing(pairs_of(read_settings(config, rule=rule, pairs=pairs)))


def recipe(
    logs: Sequence[Path],
    config: Path | None,
    *,
    old: CaseSpec | None = None,
    rule: str | None = None,
    pairs: str | None = None,
    epochs: int | None = None,
    as_recorded: bool | None = None,
    resume_after: int | None = None,
    physics: bool | None = None,
) -> CaseSpec:
    """Return what a case is to run; an option that is None is as the old case has it.

    Parameters
    ----------
    logs : sequence of Path
        Logs; if there are none, those of the old recipe.
    config : Path, optional
        Settings of the learner (TOML).
    old : CaseSpec, optional
        What the case ran until now, if there is one.
    rule : str, optional
        The learning rule, where the settings do not name it.
    pairs : str, optional
        The pairing rule, where the settings do not name it.
    epochs, as_recorded, resume_after, physics
        As in `CaseSpec`.

    Raises
    ------
    ConfigError
        If there are no logs or settings, the file cannot be read, or a setting is bad.
    LogError
        If it is unknown how many epochs a recorded session had.
    """
    old = old or _new_case(logs, config, rule=rule, pairs=pairs)
    learner = old.learner
    if not (config is None and rule is None):
        before = pairs_of(learner) if learner and rule is None else None
        learner = read_settings(config, rule=rule, pairs=pairs, before=before)
    elif pairs is not None:
        learner = with_pairs(learner, pairs)
    learned, follows = tuple(logs) or old.logs, old.as_recorded if as_recorded is None else as_recorded
    learner = with_pairs_for(learner, learned, as_recorded=follows)
    case = replace(
        old,
        logs=learned,
        learner=learner,
        schedule=replace(old.schedule, topics=find_pairing(pairs_of(learner)).topics(recorded_hands(learned[0]))),
        as_recorded=follows,
        resume_after=resume_after or old.resume_after,
        physics=old.physics if physics is None else physics,
    )
    if case.as_recorded and (logs or epochs or not old.as_recorded):
        session = RecordedSession(case.logs[0], epochs=epochs, topics=case.schedule.topics)
        return replace(case, schedule=Schedule.from_dict(session.offer().schedule))
    return case if epochs is None else replace(case, schedule=replace(case.schedule, epochs=epochs))


def check_new_case(logs: Sequence[Path], config: Path | None, *, rule: str | None) -> None:
    """Check that a new case has what it needs; raises ConfigError, which names what is missing."""
    missing = ["no logs"] * (not logs) + ["no --config"] * (config is None and rule is None)
    if missing:
        raise ConfigError(f"expected logs and --config for a new case, found {' and '.join(missing)}")


def _new_case(logs: Sequence[Path], config: Path | None, *, rule: str | None, pairs: str | None) -> CaseSpec:
    check_new_case(logs, config, rule=rule)
    settings = without_pairs(read_settings(config, rule=rule, pairs=pairs))
    return CaseSpec(tuple(logs), {}, settings.schedule(_EPOCHS))
