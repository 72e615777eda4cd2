"""Parts of the paper's error: delay of the network, lag of the teacher, and what its motion does not cover."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from pipeline.evaluation.errors import HandErrors, linear_joints
from pipeline.learner.controller import Controller
from pipeline.learner.registry import default_config
from pipeline.paper.comparison.rules import REACHED, Motions, answer_of, errors_of
from pipeline.robot.config import RobotConfig
from pipeline.samples.pairs import read_samples
from pipeline.training.trainer import train
from replay.sources.schedule import Schedule

HOLD = 10
"""Ticks for which a target is held, so that the delay of the network is over at their end."""


@dataclass(frozen=True)
class ErrorPart:
    """Error with one cause taken away.

    Attributes
    ----------
    name, title : str
        Its key in results, and what was done.
    errors : tuple of mapping of str to HandErrors
        For each controller, by motion.
    """

    name: str
    title: str
    errors: tuple[Mapping[str, HandErrors], ...]


def error_parts(
    networks: Sequence[Controller],
    log: Path,
    volume_log: Path,
    *,
    robot: RobotConfig,
    motions: Motions,
    epochs: int,
) -> Iterator[ErrorPart]:
    """Take causes of the error away, one by one.

    Parameters
    ----------
    networks : sequence of Controller
        Networks that learned pattern 1 by the paper's rule.
    log, volume_log : Path
        What they learned from, and an exploration of the whole volume.
    robot : RobotConfig
        The robot.
    motions : mapping of str to ndarray
        What they are tried on.
    epochs : int
        Epochs in which networks learn.
    """
    tried = partial(errors_of, robot, motions=motions)
    yield ErrorPart("papers_rule", "the paper's rule, on circles", tuple(tried(answer_of(one)) for one in networks))
    held = tuple(tried(answer_of(one, hold=HOLD)) for one in networks)
    yield ErrorPart("held", f"the same networks, each target held for {HOLD} ticks: no delay", held)
    for name, title, learned in (
        ("reached", "one network that learned circles as reached: no lag of the teacher", log),
        ("covered", "one network that learned the whole volume as reached: no motion beyond it", volume_log),
    ):
        schedule = Schedule(epochs=epochs)
        network = train([learned], schedule=schedule, config=default_config(), pairs=REACHED).controller()
        yield ErrorPart(name, title, (tried(answer_of(network)),))
        yield ErrorPart(f"{name}_held", f"{title}; held", (tried(answer_of(network, hold=HOLD)),))
    for name, title, learned, pairs in (
        ("linear", "linear least squares, circles as asked for", log, None),
        ("linear_reached", "linear least squares, circles as reached", log, REACHED),
    ):
        samples = read_samples(learned) if pairs is None else read_samples(learned, pairs=pairs)
        answer = partial(_linear, samples.targets, samples.joints)
        yield ErrorPart(name, title, (tried(answer),))


def _linear(targets: np.ndarray, joints: np.ndarray, asked: np.ndarray) -> np.ndarray:
    return linear_joints(targets, joints, asked=asked)
