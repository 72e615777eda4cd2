"""Whether a log can be trained: what `train` would learn from it, or what it would refuse it for."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

from pipeline.alignment.align import align_logs
from pipeline.alignment.aligned_log import AlignedLog
from pipeline.alignment.config import AlignmentConfig
from pipeline.learner.registry import default_config, rule_names
from pipeline.learner.rule import DEFAULT
from pipeline.robot.config import RobotConfig
from pipeline.robot.recorded import recorded_hands, recorded_robot
from pipeline.samples.pairing import PairingRule
from pipeline.samples.pairs import read_samples
from pipeline.training.joint_extent import JointExtent
from pipeline.training.pairing_choice import pairing_for, pairing_of
from recorders.containers.opening import open_log
from recorders.containers.reader import Opened
from recorders.errors import ConfigError, ReenactError


@dataclass(frozen=True)
class Trainability:
    """What `train` would make of a log.

    Attributes
    ----------
    samples : int or None
        How many samples it would learn from; None if that was not looked at, as no robot is known.
    pairs : str
        Name of the pairing rule.
    alignment : tuple of str
        How topics were aligned to ticks, in lines; none where the log carries ticks.
    reason : str
        Why it would learn nothing, or why that was not looked at; of the usual rule, where another one would learn.
    rule : str
        Name of the learning rule that `train` is to be given; none where the usual one learns.
    notes : tuple of str
        What of it teaches little, in lines.
    """

    samples: int | None = None
    pairs: str = ""
    alignment: tuple[str, ...] = ()
    reason: str = ""
    rule: str = ""
    notes: tuple[str, ...] = ()

    @property
    def possible(self) -> bool | None:
        """Whether the log can be trained; None if that was not looked at."""
        return None if self.samples is None else self.samples > 0

    def text(self) -> str:
        """Return the same in words."""
        if self.samples is None:
            return f"not looked at: {self.reason}"
        if not self.samples:
            return f"no, because {self.reason}"
        if not self.rule:
            return f"yes, with {self.samples} samples, pairs {self.pairs}"
        return (
            f"yes, with --rule {self.rule}: {self.samples} samples, pairs {self.pairs}; "
            f"not with {DEFAULT}, because {self.reason}"
        )

    def to_dict(self) -> dict[str, object]:
        """Return the same as JSON values."""
        found: dict[str, object] = {"possible": self.possible, "samples": self.samples, "pairs": self.pairs or None}
        found |= {"rule": self.rule or None, "notes": list(self.notes)}
        return found | {"alignment": list(self.alignment), "reason": self.reason or None}


def trainability(
    log: Opened,
    *,
    rule: str | None = None,
    robot: RobotConfig | None = None,
    alignment: AlignmentConfig,
    renames: Mapping[str, str] = MappingProxyType({}),
) -> Trainability:
    """Do what `train` does up to the samples; what is wrong with the log is part of the answer.

    Parameters
    ----------
    log : Path, Parts or Reader
        The log.
    rule : str, optional
        Learning rule; if left out the usual one or, where that would learn nothing, the first of the others that would.
    robot : RobotConfig, optional
        The robot, for a log that carries none.
    alignment : AlignmentConfig
        How its topics become ticks, if it carries none.
    renames : mapping of str to str
        Our topic names for those of the log.

    Raises
    ------
    ConfigError
        If there is no such rule, or a setting of alignment cannot be met.
    """

    def found_with(name: str) -> Trainability:
        """Return what a rule would make of the log."""
        return _trainability(log, pairing_of(default_config(name)), robot, alignment, renames)

    first = found_with(rule or DEFAULT)
    if rule is not None or first.possible is not False:
        return first
    reasons = [first.reason]
    for other in rule_names():
        if other == DEFAULT:
            continue
        found = found_with(other)
        if found.possible:
            return replace(found, reason=first.reason, rule=other)
        if found.reason != first.reason:
            reasons.append(f"with --rule {other}: {found.reason}")
    return replace(first, reason="; ".join(reasons))


def _trainability(
    log: Opened,
    asked: PairingRule,
    robot: RobotConfig | None,
    alignment: AlignmentConfig,
    renames: Mapping[str, str],
) -> Trainability:
    """Return what `train` would make of a log with one pairing rule."""
    try:
        if robot is None and recorded_robot(open_log(log)) is None:
            return Trainability(reason="the log carries no robot; --robot names one")
        tick = asked.topics(recorded_hands(log, robot=robot, renames=renames))
        (aligned,), left = align_logs([log], alignment, robot=robot, renames=renames, tick=tick)
        pairing = pairing_for(asked, [aligned], robot=robot, renames=left)
        samples = read_samples(aligned, robot=robot, pairs=pairing.name, renames=left)
        extent = JointExtent(samples.robot)
        extent.take(samples.joints)
        extent.check_moved(len(samples.targets))
    except ConfigError:
        raise
    except ReenactError as error:
        return Trainability(samples=0, reason=str(error))
    lines = aligned.summary.lines(aligned.path.name) if isinstance(aligned, AlignedLog) else ()
    count = len(samples.targets)
    return Trainability(count, pairing.name, tuple(lines), notes=tuple(extent.notes(count)))
