"""A process that learns from logs and prints the errors on the way as lines of JSON; to be run as a module."""

import json
import os
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from pipeline.evaluation.errors import hand_errors
from pipeline.learner.registry import default_config
from pipeline.robot.kinematics import Kinematics
from pipeline.robot.recorded import offered_robot, recorded_hands
from pipeline.training.pairing_choice import pairing_for, pairing_of
from pipeline.training.run import PIECE, CycleReport, Steps
from pipeline.training.trainer import Trainer, train_on
from recorders.errors import ReenactError
from replay.sources.schedule import Schedule
from replay.sources.scheduled import Replay

_CM_PER_M = 100.0
_LEAST_STEPS = PIECE // 2
_NICENESS = 10  # commands of controllers beside it come first

Show = Callable[[float, float, Sequence[float]], None]
"""Takes how many passes over the logs are through, of how many, and the error of each hand [cm] there."""


def learn(rule: str, out: Path, logs: Sequence[Path], show: Show) -> None:
    """Train a controller from logs as `reenact train` does, and save it.

    What is shown is the error of each pass that is evaluated; where one pass is learned from, before that of some of
    its targets at a time, each from before its update.

    Raises
    ------
    ReenactError
        If a log, its robot or a message is not what it should be, or nothing was learned.
    """
    config = default_config(rule)
    pairing = pairing_for(pairing_of(config, None), logs)
    replay = Replay(logs, config.schedule(None, pairing.topics(recorded_hands(logs[0]))))
    offer = replay.offer()
    schedule = Schedule.from_dict(offer.schedule)
    trainer = Trainer(config, pairs=pairing.name)
    if schedule.epochs == 1:
        ticks = sum(episode.count for episode in replay.episodes) / len(schedule.topics)
        trainer.show_steps_to(_StepsShown(Kinematics(offered_robot(offer)), ticks, schedule.cycles, show))
    trainer.report_to(lambda report: _show_cycle(report, schedule, show))
    train_on(replay, trainer)
    trainer.check_learned()
    trainer.check_moved()
    trainer.controller().save(out)


def _show_cycle(report: CycleReport, schedule: Schedule, show: Show) -> None:
    if report.hands_cm is not None:
        show(report.epoch * schedule.cycles + report.cycle + 1.0, schedule.epochs * schedule.cycles, report.hands_cm)


class _StepsShown:
    """Shows the mean errors of the steps of the first pass."""

    def __init__(self, kinematics: Kinematics, ticks: float, passes: int, show: Show) -> None:
        self._kinematics, self._ticks, self._passes, self._show = kinematics, ticks, passes, show
        self._steps = 0

    def __call__(self, steps: Steps) -> None:
        self._steps += len(steps.u)
        if self._steps > self._ticks or len(steps.u) < _LEAST_STEPS:  # the mean of a few says little
            return
        errors = hand_errors(self._kinematics, steps.outputs[:, steps.u.shape[1] :], steps.u)
        self._show(self._steps / self._ticks, self._passes, (errors.mean(axis=0) * _CM_PER_M).tolist())


def main() -> None:
    """Learn by a rule, into a file, from logs: the arguments."""
    os.nice(_NICENESS)
    rule, out, *logs = sys.argv[1:]

    def show(passes: float, of: float, hands_cm: Sequence[float]) -> None:
        """Print a line."""
        sys.stdout.write(json.dumps([passes, of, *hands_cm]) + "\n")
        sys.stdout.flush()

    try:
        learn(rule, Path(out), [Path(log) for log in logs], show)
    except ReenactError as error:
        sys.stderr.write(f"reenact: {error}\n")
        sys.exit(error.exit_status)


if __name__ == "__main__":
    main()
