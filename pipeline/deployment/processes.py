"""A robot and the controller that serves it, both started here, each in a process of its own, over loopback."""

import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager

from pipeline.deployment.session_folder import session_folder
from pipeline.deployment.verb_process import IN_NAMESPACE, VerbProcess
from pipeline.learner.controller import Controller
from pipeline.robot.config import TOML_FILE, URDF_FILE
from pipeline.robot_node.client import RemoteRobot
from recorders.errors import WireError
from recorders.nodes.keys import controller_key
from recorders.wire.keys.namespace import DEFAULT_NAMESPACE
from recorders.wire.loopback import free_endpoint
from recorders.wire.session import Session, SessionConfig, open_session

_NAME = "controller"  # by which `serve` is known by default
_POLL_S = 0.1


@contextmanager
def served_robot(controller: Controller, *, wait_s: float) -> Iterator[tuple[Session, RemoteRobot]]:
    """Run `reenact robot`, in lockstep, and `reenact serve` while the block runs.

    Parameters
    ----------
    controller : Controller
        Served; the robot is the one that it carries.
    wait_s : float
        How long the two may take to start [s].

    Yields
    ------
    (Session, RemoteRobot)
        A session that reaches both, and the robot.

    Raises
    ------
    WireError
        If one of them does not start; also, with the last line that it printed, if it ends while the block runs.
    """
    endpoint = free_endpoint()
    with session_folder() as folder, ExitStack() as stack:
        controller.save(folder / "controller.npz")
        (folder / TOML_FILE).write_text(controller.robot_toml, encoding="utf-8")
        (folder / URDF_FILE).write_text(controller.robot_urdf, encoding="utf-8")
        processes = [
            stack.enter_context(VerbProcess(folder, "robot", "--robot", folder, "--listen", endpoint, *IN_NAMESPACE)),
            stack.enter_context(
                VerbProcess(folder, "serve", folder / "controller.npz", "--connect", endpoint, *IN_NAMESPACE)
            ),
        ]
        try:
            session = stack.enter_context(open_session(SessionConfig(connect=(endpoint,), wait_s=wait_s)))
            robot = RemoteRobot(session, wait_s=wait_s)
            _await_controller(session, processes, wait_s=wait_s)
            yield session, robot
        except WireError as error:
            # The reason for which a process ended is worth more than that it does not answer.
            raise WireError(next(filter(None, map(VerbProcess.complaint, processes)), str(error))) from error


def _await_controller(session: Session, processes: Sequence[VerbProcess], *, wait_s: float) -> None:
    key = controller_key(DEFAULT_NAMESPACE, _NAME, "alive")
    deadline_s = time.monotonic() + wait_s
    while not any(reply.ok is not None for reply in session.liveliness().get(key, timeout=1.0)):
        if time.monotonic() > deadline_s or any(process.complaint() for process in processes):
            raise WireError(f"the controller did not begin to serve within {wait_s:g} s")
        time.sleep(_POLL_S)
