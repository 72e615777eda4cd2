"""Checks of a namespace: other controllers, a robot of other joints or in lockstep."""

import logging
import threading
from collections.abc import Iterator
from contextlib import contextmanager

from pipeline.robot_node.protocol import RobotStatus, robot_key
from recorders.errors import JointError, WireError
from recorders.nodes.keys import controller_key
from recorders.text.once import OnceWarner
from recorders.text.wording import escape_control
from recorders.wire.keys.topic_keys import TopicKeys
from recorders.wire.session import Session, watching_tokens

logger = logging.getLogger(__name__)

_ANSWER_S = 5.0  # who is there already answers within milliseconds; this machine may be very busy
_LOCKSTEP = (
    "the robot moves in lockstep: it refuses a command unless the targets are stamped with its own time; "
    "for any others start it with --real-time"
)
_MAX_STATUS = 1 << 16  # anybody may answer [bytes]
_SHOWN = 5  # joints in a line
_MAX_NAME = 100
_MAX_LINES = 100  # anybody may answer, again and again


def refuse_other_controllers(session: Session, name: str, *, keys: TopicKeys, allow_multiple: bool) -> None:
    """Check that no other controller serves: a robot that two of them command does what neither has learned.

    Parameters
    ----------
    session : Session
        An open session; a controller that it does not reach yet is not found.
    name : str
        Name of the controller that is about to serve; a second one of this name is refused in any case.
    keys : TopicKeys
        Keys of the topics, and the namespace.
    allow_multiple : bool
        Whether others, of other names, are welcome.

    Raises
    ------
    WireError
        If there is one.
    """
    replies = session.liveliness().get(controller_key(keys.namespace, "*", "alive"), timeout=_ANSWER_S)
    others = sorted(str(reply.ok.key_expr).split("/")[-2] for reply in replies if reply.ok is not None)
    if name in others:
        both = "choose another --name" if allow_multiple else "allow both with --allow-multiple and another --name"
    elif others and not allow_multiple:
        both = "allow both with --allow-multiple"
    else:
        return
    raise WireError(
        f"controller '{name if name in others else others[0]}' serves in {keys.words} already: end it, "
        f"choose {keys.alternative}, or {both}"
    )


class RobotCheck:
    """Asks the robot of a namespace whether it is the one that a controller or learner is for.

    What whoever sends the targets may not know is logged, once each.

    Parameters
    ----------
    session : Session
        An open session.
    joints : tuple of str
        Joints that the controller commands, or that the learner reads.
    namespace : str
        First part of every key.
    learner : bool
        Whether this is a learner: it sends no commands, and reads only its joints, whatever others there are.
    """

    def __init__(
        self,
        session: Session,
        joints: tuple[str, ...],
        *,
        namespace: str,
        learner: bool = False,
    ) -> None:
        self._session = session
        self._joints = joints
        self._namespace = namespace
        self._who = "learner" if learner else "controller"
        self._commands = not learner
        self._warnings = OnceWarner(logger, limit=_MAX_LINES)
        self._came = threading.Event()

    @contextmanager
    def watching(self) -> Iterator[None]:
        """Notice every robot that comes while the block runs; `check_newcomer` looks at it."""
        key = robot_key(self._namespace, "alive")
        with watching_tokens(self._session, key, self._on_token):
            yield

    def check(self) -> None:
        """Ask the robot that is there already, if one is.

        Raises
        ------
        JointError
            If its joints are not those of the controller.
        """
        if (difference := self._ask()) is not None:
            raise JointError(f"{difference}; serve a controller of this robot, or choose its --namespace")

    def check_newcomer(self) -> None:
        """Ask a robot that has come since the last call, and warn if its joints are not those of the controller."""
        if self._came.is_set():
            self._came.clear()
            self.warn()

    def warn(self) -> None:
        """Ask the robot that is there, if one is, and warn if its joints are not those of the controller or learner."""
        if (difference := self._ask()) is not None:
            outcome = "it refuses the commands" if self._commands else "nothing can be learned from it"
            self._warnings.warn(f"warning: {difference}; {outcome}")

    def _ask(self) -> str | None:
        """Return in what a robot differs, if it answers and does."""
        for reply in self._session.get(robot_key(self._namespace, "status"), timeout=_ANSWER_S):
            if reply.ok is None or len(reply.ok.payload) > _MAX_STATUS:
                continue
            try:
                status = RobotStatus.from_json(reply.ok.payload.to_bytes())
            except WireError:  # not a robot of ours: whatever it is will report itself what it refuses
                continue
            if difference := self._difference(status):
                return difference
            if self._commands and not status.real_time:
                self._warnings.warn(_LOCKSTEP)
        return None

    def _difference(self, status: RobotStatus) -> str | None:
        ours, theirs = set(self._joints), set(status.joints)
        if not theirs or ours == theirs or (ours < theirs and not self._commands):
            return None
        parts = [_named("it lacks", ours - theirs), _named(f"the {self._who} lacks", theirs - ours)]
        name = escape_control(status.robot[:_MAX_NAME])
        return f"robot '{name}' has other joints than the {self._who}: {', '.join(filter(None, parts))}"

    def _on_token(self, _key: str, is_there: bool) -> None:
        if is_there:
            self._came.set()


def _named(words: str, joints: set[str]) -> str:
    """Return the first of some joints behind words, and how many more there are; nothing without any."""
    if not joints:
        return ""
    first = [escape_control(name[:_MAX_NAME]) for name in sorted(joints)[:_SHOWN]]
    more = f" and {len(joints) - _SHOWN} more" if len(joints) > _SHOWN else ""
    return f"{words} {', '.join(first)}{more}"
