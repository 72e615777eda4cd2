"""The first divergence of two files of one kind: two logs, or two controllers."""

from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

from pipeline.learner.controller import Controller, is_controller
from pipeline.learner.controller_diff import ControllerDifference, first_difference
from recorders.containers.opening import open_log
from recorders.errors import ConfigError, LogError, ReenactError
from recorders.messages.topic_patterns import chosen
from recorders.reading.parts import is_log, one_session
from replay.diff.divergence import Divergence, first_divergence
from replay.diff.rules import Rules


@dataclass(frozen=True)
class DiffConfig:
    """Settings of a comparison of two recordings.

    Parameters
    ----------
    topics : tuple of str
        Patterns of topics to compare; all if empty.
    ignored : tuple of str
        Patterns of topics, and fields of messages, that do not count.
    tolerance : float, optional
        How far two numbers may be apart [unit of the field].
    """

    topics: tuple[str, ...] = ()
    ignored: tuple[str, ...] = ()
    tolerance: float | None = None

    @property
    def rules(self) -> Rules:
        """Rules of equality; raises ConfigError if a field is none."""
        return Rules(tuple(name for name in self.ignored if not name.startswith("/")), self.tolerance)

    def choose(self, topics: Collection[str]) -> frozenset[str]:
        """Return those of the topics that are compared; raises LogError if a pattern names none, or none is left."""
        left_out = chosen([name for name in self.ignored if name.startswith("/")], topics, option="--ignore")
        left = (chosen(self.topics, topics, option="--topic") if self.topics else frozenset(topics)) - left_out
        if topics and not left:
            raise LogError("--topic and --ignore: expected a topic that is left to compare, found none")
        return left


def diff(a: Path, b: Path, config: DiffConfig | None = None) -> Divergence | ControllerDifference | None:
    """Return where two recordings or two controllers first differ, None if they do not.

    `str()` of what is returned is one line for the user, `dataclasses.asdict` the same for JSON.

    Raises
    ------
    ReenactError
        If the files are not of one kind, one of them cannot be read, a topic or field is none, or nothing is left to
        compare.
    """
    config = config or DiffConfig()
    rules = config.rules
    if is_log(a) and is_log(b):
        left, right = (open_log(one_session([path])) for path in (a, b))
        topics = config.choose(left.topics.keys() | right.topics.keys())
        return first_divergence(left.records(topics=topics), right.records(topics=topics), rules)
    if config != DiffConfig():
        raise ConfigError("--topic, --ignore and --tolerance: expected two logs beside them")
    if is_controller(a) and is_controller(b):
        return first_difference(Controller.load(a), Controller.load(b))
    for path in (a, b):
        if not (path.exists() or is_log(path)):
            raise LogError(f"{path}: no such file")
    raise ReenactError(f"expected two logs (.mcap) or two controllers (.npz), found {a.name} and {b.name}")
