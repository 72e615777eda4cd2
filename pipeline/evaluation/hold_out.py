"""Ticks of logs that are left aside while the rest is learned, and the error on them."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from fractions import Fraction
from itertools import islice
from typing import Any

import numpy as np

from pipeline.evaluation.trials import Trial, evaluate_samples
from pipeline.learner.controller import Controller
from pipeline.robot.config import RobotConfig
from pipeline.samples.pairs import Samples, read_samples
from recorders.cdr.codec import stamp_ns
from recorders.containers.opening import open_log
from recorders.containers.reader import DelegatingReader, Opened, Reader
from recorders.errors import ConfigError, LogError
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import SAMPLE_JOINTS
from recorders.reading.raw_messages import FOREVER_NS


class Excerpt(DelegatingReader):
    """The messages of a log from one stamp on and before another; those without a stamp are in every excerpt.

    Parameters
    ----------
    reader : Reader
        The log.
    from_ns, before_ns : int
        Stamps [ns].
    """

    def __init__(self, reader: Reader, *, from_ns: int = 0, before_ns: int = FOREVER_NS) -> None:
        super().__init__(reader)
        self._from_ns, self._before_ns = from_ns, before_ns

    def records(
        self,
        *,
        topics: Iterable[str] | None = None,
        start_ns: int = 0,
        end_ns: int = FOREVER_NS,
        file_order: bool = False,
    ) -> Iterator[RecordedMessage]:
        """Yield the messages, in the order of the log."""
        found = self._reader.records(topics=topics, start_ns=start_ns, end_ns=end_ns, file_order=file_order)
        for record in found:
            stamp = stamp_ns(record.type, record.data)
            if stamp is None or self._from_ns <= stamp < self._before_ns:
                yield record


def parse_share(text: str) -> Fraction:
    """Return a share that is written as a number; raises ConfigError if it is none between 0 and 1.

    Examples
    --------
    >>> parse_share("0.2")
    Fraction(1, 5)
    """
    try:
        share = Fraction(text)
    except (ValueError, ZeroDivisionError):
        share = Fraction(0)
    if not 0 < share < 1:
        raise ConfigError(f"--hold-out: expected a share between 0 and 1, such as 0.2, or a log, found {text[:80]!r}")
    return share


def split_log(log: Opened, share: Fraction, renames: Mapping[str, str]) -> tuple[Excerpt, Excerpt]:
    """Return a log up to where the last ticks are left aside, and these.

    Parameters
    ----------
    log : Path, Parts or Reader
        A log of ticks.
    share : Fraction
        How many of its ticks are left aside, rounded to whole ones.
    renames : mapping of str to str
        Our topic names for those that it uses.

    Raises
    ------
    LogError
        If it cannot be read, or has too few ticks for both.
    """
    reader = open_log(log)
    joints = next((name for name, ours in renames.items() if ours == SAMPLE_JOINTS), SAMPLE_JOINTS)
    ticks = reader.counts.get(joints, 0)
    learned = ticks - round(ticks * share)
    if not 1 <= learned < ticks:
        raise LogError(f"{reader.path}: expected ticks to learn and ticks to leave aside, found {ticks} in all")
    first = next(islice(reader.records(topics=[joints]), learned, None), None)
    if first is None:
        raise LogError(
            f"{reader.path}: expected {ticks} messages on {joints}, as the log counts, found at most {learned}"
        )
    cut_ns = stamp_ns(first.type, first.data) or 0
    return Excerpt(reader, before_ns=cut_ns), Excerpt(reader, from_ns=cut_ns)


def held_out_error(
    controller: Controller,
    logs: Sequence[Opened],
    *,
    robot: RobotConfig | None,
    pairs: str,
    renames: Mapping[str, str],
) -> dict[str, Any]:
    """Return the errors of a controller on what was left aside, as JSON has them.

    Parameters
    ----------
    controller : Controller
        What was learned.
    logs : sequence of Path, Parts or Reader
        What was left aside.
    robot : RobotConfig, optional
        The robot, for logs that carry none.
    pairs : str
        Name of the pairing rule.
    renames : mapping of str to str
        Our topic names for those that they use.

    Returns
    -------
    dict
        `HandErrors.to_dict`, and under `joints`, by name, the mean and the largest distance of the joints that are
        answered from those that were measured [rad or m]: of a robot with joints to spare, other postures are as good.
    """
    read = [read_samples(log, robot=robot, pairs=pairs, renames=renames) for log in logs]
    samples = Samples(
        np.concatenate([part.targets for part in read]), np.concatenate([part.joints for part in read]), read[0].robot
    )
    trial = evaluate_samples(controller, samples, name="what was left aside")
    return {**trial.errors.to_dict(), "joints": _joint_errors(trial, samples)}


def _joint_errors(trial: Trial, samples: Samples) -> dict[str, dict[str, float]]:
    apart = np.abs(trial.joints - samples.joints)
    return {
        name: {"mean": float(apart[:, place].mean()), "max": float(apart[:, place].max())}
        for place, name in enumerate(samples.robot.joints)
    }
