"""Choice of the pairing rule for logs: the one that is asked for, or the one in its place where a log lacks topics."""

from collections.abc import Mapping, Sequence
from types import MappingProxyType

from pipeline.learner.registry import find_rule
from pipeline.learner.rule import Settings
from pipeline.robot.config import RobotConfig
from pipeline.robot.recorded import recorded_hands
from pipeline.samples.pairing import PairingRule, find_pairing, fitting_pairing
from recorders.containers.opening import open_log
from recorders.containers.reader import Opened
from replay.sources.session import stated_topics

_NO_RENAMES: Mapping[str, str] = MappingProxyType({})


def pairing_of(config: Settings, pairs: str | None = None) -> PairingRule:
    """Return a pairing rule by its name, that of a configuration's learning rule if none is named.

    Raises
    ------
    ConfigError
        If there is none of this name.
    """
    return find_pairing(pairs or find_rule(config.rule).pairs)


def pairing_for(
    pairing: PairingRule,
    logs: Sequence[Opened],
    *,
    robot: RobotConfig | None = None,
    renames: Mapping[str, str] = _NO_RENAMES,
    as_recorded: bool = False,
) -> PairingRule:
    """Return a pairing rule, or the one in its place where a log lacks topics of it.

    Parameters
    ----------
    pairing : PairingRule
        The rule that is asked for.
    logs : sequence of Path, Parts or Reader
        All the logs that are learned.
    robot : RobotConfig, optional
        The robot; that of the first log if left out.
    renames : mapping of str to str
        Our topic names for those that the logs use.
    as_recorded : bool
        Whether a log counts as the stream that it is a recording of: what it has beside that was no learner's.

    Raises
    ------
    LogError, RobotError
        If a log cannot be read, or its robot cannot be used.
    """
    if not pairing.otherwise or not logs:
        return pairing
    hands = recorded_hands(logs[0], robot=robot, renames=renames)
    for log in logs:
        reader = open_log(log)
        there = {renames.get(topic, topic) for topic, count in reader.counts.items() if count > 0}
        if as_recorded and (stated := stated_topics(reader)) is not None:
            there &= set(stated)
        pairing = fitting_pairing(pairing, hands, there, where=str(reader.path))
    return pairing
