"""`open_log`, behind which every log opens; the table of containers."""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from recorders.containers.bag_folder import BagFolder
from recorders.containers.reader import Opened, Reader
from recorders.containers.ros1_bag import Ros1Bag
from recorders.containers.sqlite_bag import SqliteBag
from recorders.containers.translated import translated
from recorders.errors import LogError, MissingExtra, unreadable
from recorders.files.regular_file import require_regular_file
from recorders.reading.bag_metadata import is_bag_folder
from recorders.reading.file_kind import ROS1_MAGIC, SQLITE_MAGIC
from recorders.reading.lerobot_info import is_lerobot_folder
from recorders.reading.parts import Log, Parts, find_log
from recorders.reading.reader import LogReader
from recorders.reading.session_reader import SessionReader


class Container(NamedTuple):
    """A container of logs.

    Attributes
    ----------
    name : str
        What it is called.
    holds : callable
        Whether a log is in it, by its path and its first bytes, of which a folder has none.
    open : callable
        Makes a reader of the log.
    """

    name: str
    holds: Callable[[Path, bytes], bool]
    open: Callable[[Path], Reader]


def _open_dataset(path: Path) -> Reader:
    try:
        from recorders.containers.lerobot.dataset import LeRobotDataset  # noqa: PLC0415  # of an extra
    except ModuleNotFoundError:
        raise MissingExtra("pyarrow", "parquet") from None
    return LeRobotDataset(path)


CONTAINERS = (
    Container("rosbag2 folder", lambda path, begin: path.is_dir() and is_bag_folder(path), BagFolder),
    Container("LeRobotDataset", lambda path, begin: path.is_dir() and is_lerobot_folder(path), _open_dataset),
    Container("rosbag2 file (.db3)", lambda path, begin: begin.startswith(SQLITE_MAGIC), SqliteBag),
    Container("ROS 1 bag", lambda path, begin: begin.startswith(ROS1_MAGIC), Ros1Bag),
    Container("MCAP", lambda path, begin: True, LogReader),  # the last one refuses what no other opens
)
"""The containers, in the order in which they are tried."""


def open_log(log: Opened) -> Reader:
    """Return what reads a recording, whatever container it is in; its messages are ours wherever they can be.

    Joints, poses, transforms, texts and numbers in another encoding than CDR, or of other definitions than ROS 2's,
    come out as our types in CDR: see `recorders.containers.translated`. Everything else comes as it is.

    Parameters
    ----------
    log : Path, Parts or Reader
        A log, a session's parts, named one by one, by their folder or by their stem, or a folder of rosbag2 or of
        LeRobot; what reads one already is returned.

    Raises
    ------
    LogError
        If there is none, or it is none that can be read.
    """
    return translated(open_as_it_is(log)) if isinstance(log, Path | Parts) else log


def open_as_it_is(log: Log) -> Reader:
    """Return what reads a recording with the bytes and encodings that it has; raises LogError as `open_log` does."""
    found = find_log(log) if isinstance(log, Path) else log
    if isinstance(found, Parts):
        return SessionReader(found)
    return container_of(found).open(found)


def container_of(log: Path) -> Container:
    """Return the container of a recording, by its content; raises LogError if it is not there."""
    begin = _first_bytes(log)
    return next(container for container in CONTAINERS if container.holds(log, begin))


def is_foreign_container(log: Path) -> bool:
    """Whether there is a recording of this name in another container than MCAP."""
    return log.exists() and container_of(log).open is not LogReader


def _first_bytes(path: Path) -> bytes:
    if path.is_dir():
        return b""
    require_regular_file(path)
    try:
        with path.open("rb") as file:
            return file.read(16)
    except OSError as error:
        raise LogError(unreadable(path, error)) from error
