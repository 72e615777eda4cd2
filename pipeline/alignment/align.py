"""Alignment of logs where they need it: those that carry ticks go on as they are, unless more is asked for."""

from collections.abc import Collection, Mapping, Sequence

from pipeline.alignment.aligned_log import AlignedLog
from pipeline.alignment.config import AlignmentConfig
from pipeline.robot.config import RobotConfig
from pipeline.robot.recorded import recorded_robot
from recorders.cdr.codec import stamp_ns
from recorders.containers.opening import open_log
from recorders.containers.reader import Opened, Reader
from recorders.containers.translated import as_poses
from recorders.errors import ConfigError, MessageError, ReenactError
from recorders.messages.topics import ROBOT_DESCRIPTION, SAMPLE_JOINTS, is_measured
from recorders.text.wording import names_text
from replay.sources.scheduled import ROBOT_FILES, check_renames, renamed

_LOOKED_AT = 4096  # messages, to see whether their stamps meet


def align_logs(
    logs: Sequence[Opened],
    config: AlignmentConfig,
    *,
    robot: RobotConfig | None,
    renames: Mapping[str, str],
    tick: Sequence[str],
) -> tuple[list[Opened], Mapping[str, str]]:
    """Return logs of ticks, and the renames that are still to be made in them.

    Logs that all carry ticks are returned as they are. If one does not, or an option is given, all are aligned.

    Parameters
    ----------
    logs : sequence of Path, Parts or Reader
        The logs.
    config : AlignmentConfig
        What is asked for.
    robot : RobotConfig, optional
        The robot; that of each log if left out.
    renames : mapping of str to str
        Our topic names for those that the logs use.
    tick : sequence of str
        Our names of the topics of a tick.

    Raises
    ------
    ConfigError
        If a log is to be aligned and there is no robot.
    LogError
        If one cannot be read or aligned, or no log has a topic that is to be renamed.
    """
    readers = [as_poses(open_log(log), renames) for log in logs]
    if not config.asks and all(carries_ticks(reader, renames, tick) for reader in readers):
        return list(logs), renames
    named = {topic for reader in readers for topic in reader.topics}
    where = names_text(str(reader.path) for reader in readers)
    check_renames(renames, named, where=where)
    _check_topics(config, named, where=where)
    return [_aligned(reader, config, robot, renames, tick) for reader in readers], {}


def carries_ticks(reader: Reader, renames: Mapping[str, str], tick: Sequence[str]) -> bool:
    """Return whether messages of a log meet in their stamps, or something is wrong with them that a learner names.

    A log of ours that has its robot is one of ticks, unless it is a recording of what anybody published.

    Parameters
    ----------
    reader : Reader
        The log.
    renames : mapping of str to str
        Our topic names for those that it uses.
    tick : sequence of str
        Our names of the topics of a tick.
    """
    manifest, counts = reader.manifest, reader.counts
    if manifest and manifest.get("kind") != "recording" and set(ROBOT_FILES.values()) <= set(reader.attachments):
        return True
    there = {renames.get(topic, topic) for topic, count in counts.items() if count}
    if not there.issuperset(tick):
        return bool(counts.get(SAMPLE_JOINTS)) and SAMPLE_JOINTS not in renames
    known = {foreign: ours for foreign, ours in renames.items() if foreign in counts}
    parts: dict[int | None, set[str]] = {}
    try:
        for _, record in zip(range(_LOOKED_AT), renamed(reader, known, tick), strict=False):
            parts.setdefault(stamp_ns(record.type, record.data), set()).add(record.topic)
    except (MessageError, ReenactError):
        return True
    whole = sum(found.issuperset(tick) for found in parts.values())
    others = sum(not found.issuperset(tick) and not all(map(is_measured, found)) for found in parts.values())
    return whole > 0 and whole >= others - 1  # the last that was looked at may go on


def _aligned(
    reader: Reader,
    config: AlignmentConfig,
    robot: RobotConfig | None,
    renames: Mapping[str, str],
    tick: Sequence[str],
) -> AlignedLog:
    known = robot or recorded_robot(reader)
    if known is None:
        described = bool(reader.counts.get(ROBOT_DESCRIPTION))
        hint = f"; {ROBOT_DESCRIPTION} is a URDF, of which `reenact robot new` makes one" if described else ""
        raise ConfigError(
            f"{reader.path} carries no robot, whose joints are to be aligned; give one with --robot{hint}"
        )
    return AlignedLog(reader, known, config=config, renames=renames, wanted=tick)


def _check_topics(config: AlignmentConfig, topics: Collection[str], *, where: str) -> None:
    """Check that the topics of options are there: a slip of the pen would else change nothing."""
    asked = ("--latency", config.latencies_ns), ("--frame", config.frames), ("--offset", config.offsets)
    for option, named in asked:
        if unknown := sorted(set(named) - set(topics)):
            raise ConfigError(
                f"{where}: {option}: expected a topic {names_text(unknown)}, found none; there are: "
                f"{names_text(sorted(topics)) or 'none'}"
            )
