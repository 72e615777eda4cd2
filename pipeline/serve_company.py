"""Who is there already when a controller begins to serve: other controllers, a robot that may refuse its commands."""

from collections.abc import Callable

import zenoh

from pipeline.robot_wire import RobotStatus, robot_key
from recorders.errors import WireError

_ANSWER_S = 1.0  # who is there already answers within milliseconds


def controller_key(namespace: str, name: str, verb: str) -> str:
    """Return the key of a served controller's liveliness token (`alive`) or of its status queryable (`status`)."""
    return f"{namespace}/@controller/{name}/{verb}"


def refuse_company(session: zenoh.Session, name: str, *, namespace: str, beside_others: bool) -> None:
    """Check that no other controller serves: a robot that two of them command does what neither has learned.

    Parameters
    ----------
    session : zenoh.Session
        An open session; a controller that it does not reach yet is not found.
    name : str
        Name of the controller that is about to serve; a second one of this name is refused in any case.
    namespace : str
        First part of every key.
    beside_others : bool
        Whether others, of other names, are welcome.

    Raises
    ------
    WireError
        If there is one.
    """
    replies = session.liveliness().get(controller_key(namespace, "*", "alive"), timeout=_ANSWER_S)
    others = sorted(str(reply.ok.key_expr).split("/")[-2] for reply in replies if reply.ok is not None)
    if name in others:
        both = "choose another --name" if beside_others else "allow both with --beside-others and another --name"
    elif others and not beside_others:
        both = "allow both with --beside-others"
    else:
        return
    raise WireError(
        f"controller '{name if name in others else others[0]}' serves in namespace '{namespace}' already: end it, "
        f"choose a --namespace, or {both}"
    )


def note_lockstep(session: zenoh.Session, *, namespace: str, say: Callable[[str], None]) -> None:
    """Say so if the robot takes no command but at its own time, which whoever sends the targets may not know."""
    for reply in session.get(robot_key(namespace, "status"), timeout=_ANSWER_S):
        if reply.ok is not None and _is_lockstep(reply.ok.payload.to_bytes()):
            say(
                "the robot moves in lockstep: it refuses a command unless the targets are stamped with its own time; "
                "for any others start it with --real-time"
            )


def _is_lockstep(status: bytes) -> bool:
    try:
        return not RobotStatus.from_json(status).real_time
    except WireError:  # not a robot of ours: whatever it is will say itself what it refuses
        return False
