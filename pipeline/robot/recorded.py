"""Robot of a log: its files among the attachments."""

from pipeline.robot.config import RobotConfig, parse_robot
from recorders.errors import ConfigError, LogError
from recorders.reading.session_reader import Reader
from replay.sources.scheduled import read_robot


def recorded_robot(reader: Reader) -> RobotConfig | None:
    """Return the robot that a log carries, None if it carries none; raises RobotError if it cannot be used."""
    files = read_robot(reader)
    return parse_robot(files["toml"], files["urdf"], origin=reader.path) if files else None


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
    if has_option:
        raise ConfigError(f"{reader.path}: the log carries no robot; give one with --robot")
    found = reader.attachments or "none"
    raise LogError(f"{reader.path}: expected the robot's files among the attachments, found {found}")
