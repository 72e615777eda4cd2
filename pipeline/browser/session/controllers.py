"""Controllers that stand ready to lead the robot: each a node in a process of its own, started when it is chosen."""

import threading
import time
from dataclasses import dataclass
from pathlib import Path

from pipeline.browser.session import teacher_node
from pipeline.browser.session.keys import renamed_targets
from pipeline.deployment.verb_process import IN_NAMESPACE, VerbProcess
from recorders.errors import ConfigError, WireError
from recorders.nodes.keys import controller_key, node_name
from recorders.text.wording import names_text
from recorders.wire.keys.ros_keys import RosKeys
from recorders.wire.keys.topic_keys import TopicKeys
from recorders.wire.session import Session

TEACHER = teacher_node.NAME
_WAIT_S = 60.0  # a first start compiles the kernels
_POLL_S = 0.05


@dataclass(frozen=True)
class Place:
    """Where the nodes of a session meet.

    Attributes
    ----------
    session : Session
        An open session.
    endpoints : tuple of str
        Where the nodes connect.
    keys : TopicKeys
        Keys of their topics, and their namespace.
    folder : Path
        For their files.
    hands : tuple of str
        Names of the robot's hands.
    """

    session: Session
    endpoints: tuple[str, ...]
    keys: TopicKeys
    folder: Path
    hands: tuple[str, ...]

    @property
    def namespace(self) -> str:
        """First part of their control keys."""
        return self.keys.namespace

    @property
    def arguments(self) -> list[str]:
        """Arguments by which a verb comes there."""
        connect = [part for endpoint in self.endpoints for part in ("--connect", endpoint)]
        return [*connect, "--namespace", self.namespace, *_of_domain(self.keys)]

    def await_token(self, key: str, process: VerbProcess) -> None:
        """Wait until somebody is there that has a liveliness token; raises WireError, with the reason of a process."""
        deadline_s = time.monotonic() + _WAIT_S
        while not any(reply.ok is not None for reply in self.session.liveliness().get(key, timeout=1.0)):
            if complaint := process.complaint():
                raise WireError(complaint)
            if time.monotonic() > deadline_s:
                raise WireError(f"{process.name} did not begin within {_WAIT_S:g} s")
            time.sleep(_POLL_S)


def _of_domain(keys: TopicKeys) -> list[str]:
    """Return the arguments by which a verb has the same keys of topics, whatever the settings of the project are."""
    if not isinstance(keys, RosKeys):
        return [*IN_NAMESPACE]
    node = keys.node.name
    rules = [f"__ns:={node.namespace}", *(f"{source}:={target}" for source, target in node.rules)]
    named = [part for rule in rules for part in ("--remap", rule)]
    return ["--ros", str(keys.domain), *named, *(["--humble"] if keys.humble else [])]


class Controllers:
    """The teacher and learned controllers by name.

    Parameters
    ----------
    place : Place
        Where they run.
    """

    def __init__(self, place: Place) -> None:
        self._place = place
        self._lock = threading.Lock()
        self._files: dict[str, Path] = {}
        self._processes: dict[str, VerbProcess] = {}
        self._starts = 0

    @property
    def names(self) -> tuple[str, ...]:
        """All of them, the teacher first."""
        return (TEACHER, *self._files)

    def file(self, name: str) -> Path | None:
        """Return the file of a controller; None of the teacher."""
        return self._files.get(name)

    def add(self, path: Path, name: str = "") -> str:
        """Add a controller's file under its own name or another, and return that; an earlier one of it is replaced."""
        name = node_name(name or path.stem)
        if name == TEACHER:
            raise ConfigError(f"{path}: expected another name than {TEACHER}, which the teacher has")
        with self._lock:
            earlier = self._processes.pop(name, None)
            self._files[name] = path
        if earlier is not None:
            earlier.stop()
        return name

    def remove(self, name: str) -> None:
        """Forget a controller, and end its process."""
        with self._lock:
            self._files.pop(name, None)
            process = self._processes.pop(name, None)
        if process is not None:
            process.stop()

    def start(self, name: str) -> None:
        """Start a controller, unless it runs, and wait until it answers targets.

        Raises
        ------
        ConfigError
            If there is none of this name.
        WireError
            If it does not begin; with its own reason where it ends.
        """
        with self._lock:
            if name not in self.names:
                raise ConfigError(f"expected one of {names_text(self.names)}, found {name!r:.60}")
            process = self._processes.get(name)
            if process is None or process.complaint():
                process = self._processes[name] = self._started(name)
        try:
            self._place.await_token(controller_key(self._place.namespace, name, "alive"), process)
        except WireError as error:
            raise WireError(f"{name}: {error}") from error

    def complaint(self, name: str) -> str:
        """Return why the process of a controller has ended, or nothing if it has not or never began."""
        process = self._processes.get(name)
        return "" if process is None else process.complaint()

    def pid(self, name: str) -> int:
        """Return the number of the process of a controller that was started."""
        return self._processes[name].pid

    def close(self) -> None:
        """End all processes."""
        with self._lock:
            processes, self._processes = list(self._processes.values()), {}
        for process in processes:
            process.stop()

    def _started(self, name: str) -> VerbProcess:
        place = self._place
        self._starts += 1
        unique = f"{name}_{self._starts}"
        if name == TEACHER:
            return VerbProcess(
                place.folder, "", place.endpoints[0], place.namespace, name=unique, module=teacher_node.__name__
            )
        where = (*place.arguments, "--name", name, "--allow-multiple")
        return VerbProcess(
            place.folder, "serve", self._files[name], *where, *renamed_targets(name, place.hands), name=unique
        )
