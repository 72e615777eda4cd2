"""Robot of a log, of which it is an attachment, or of a stream, in whose offer it is."""

from collections.abc import Collection, Mapping
from types import MappingProxyType

from pipeline.robot.config import RobotConfig, parse_robot
from recorders.containers.opening import open_log
from recorders.containers.reader import DelegatingReader, Opened, Reader
from recorders.errors import ConfigError, LogError, ReenactError
from recorders.messages.topics import hands_among, is_target
from recorders.protocol.stream import Offer
from recorders.text.wording import names_text
from replay.sources.scheduled import ROBOT_FILES, read_robot

_SIDES = ("left", "right")


def recorded_robot(reader: Reader) -> RobotConfig | None:
    """Return the robot that a log carries, None if it carries none; raises RobotError if it cannot be used."""
    files = read_robot(reader)
    return parse_robot(files["toml"], files["urdf"], origin=reader.path) if files else None


class _OfRobot(DelegatingReader):
    """Reader of a log that carries a robot, whatever the log itself carries.

    Parameters
    ----------
    reader : Reader
        The log.
    texts : mapping of str to str
        The robot's `toml` and `urdf`.
    """

    def __init__(self, reader: Reader, texts: Mapping[str, str]) -> None:
        super().__init__(reader)
        self._files = {ROBOT_FILES[key]: text.encode() for key, text in texts.items()}

    @property
    def attachments(self) -> tuple[str, ...]:
        """The names of the attachments, with those of the robot."""
        return tuple(dict.fromkeys((*self._reader.attachments, *self._files)))

    def attachment(self, name: str) -> bytes:
        """Return an attachment, or a file of the robot; raises LogError if there is none."""
        return self._files[name] if name in self._files else self._reader.attachment(name)


def with_robot(log: Opened, robot: RobotConfig | None) -> Opened:
    """Return a log that carries a robot, if one is given; the same log if it carries that one already.

    Raises
    ------
    LogError
        If the log cannot be read.
    """
    if robot is None:
        return log
    reader, texts = open_log(log), {"toml": robot.toml_text, "urdf": robot.urdf_text}
    return log if read_robot(reader) == texts else _OfRobot(reader, texts)


def require_recorded_robot(reader: Reader, *, has_option: bool = False) -> RobotConfig:
    """Return the robot that a log carries.

    Raises
    ------
    ConfigError
        If it carries none, and there is an option `--robot` to give one.
    LogError
        If it carries none, and there is no such option.
    RobotError
        If the robot cannot be used.
    """
    if (robot := recorded_robot(reader)) is not None:
        return robot
    raise _missing(f"{reader.path}: the log", reader.attachments, has_option=has_option)


def recorded_hands(
    log: Opened, *, robot: RobotConfig | None = None, renames: Mapping[str, str] = MappingProxyType({})
) -> tuple[str, ...]:
    """Return the names of the hands of a log: those of its robot, or of one that is given.

    Without either they are left and right, unless the log has messages on targets of others.

    Parameters
    ----------
    log : Path, Parts or Reader
        The log, or a session in parts.
    robot : RobotConfig, optional
        The robot, which counts for more than the log's.
    renames : mapping of str to str
        Our topic names for those that the log uses.

    Raises
    ------
    LogError, RobotError
        If the log cannot be read, or its robot cannot be used.
    """
    if robot is not None:
        return robot.hand_names
    reader = open_log(log)
    if (recorded := recorded_robot(reader)) is not None:
        return recorded.hand_names
    there = (renames.get(topic, topic) for topic, count in reader.counts.items() if count > 0)
    found = hands_among(filter(is_target, there))
    return _SIDES if set(found) <= set(_SIDES) else tuple(sorted(found))


def offered_robot(offer: Offer, *, has_option: bool = False) -> RobotConfig:
    """Return the robot that the offer of a stream carries; raises as `require_recorded_robot` does."""
    texts = offer.robot.get("toml"), offer.robot.get("urdf")
    if not all(isinstance(text, str) for text in texts):
        raise _missing("the stream", offer.robot, has_option=has_option)
    return parse_robot(str(texts[0]), str(texts[1]), origin="the robot of the stream")


def _missing(origin: str, found: Collection[str], *, has_option: bool) -> ReenactError:
    line = f"{origin} carries no robot"
    if has_option:
        return ConfigError(f"{line}; give one with --robot")
    return LogError(f"{line}: expected the robot's files, found {names_text(found) or 'none'}")
