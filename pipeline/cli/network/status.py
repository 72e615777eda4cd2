"""The verb status."""

import json
import sys
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pipeline.cli.options import Json
from pipeline.cli.project_settings import of_settings
from pipeline.cli.ros_domain import RosDomain
from pipeline.cli.sessions import NAMESPACE, Namespace, Wait, ZenohConfig, session_config
from pipeline.terminal import console

if TYPE_CHECKING:
    from rich.table import Table

    from recorders.wire.session import Session, SessionConfig

_WAIT_S = 1.0  # whoever is there answers within milliseconds
_EVERY_S = 1.0


@dataclass(frozen=True)
class _Look:
    """One kind of look at what runs.

    Parameters
    ----------
    find : callable
        Returns what a session reaches; None without anybody.
    to_dict : callable
        Returns it as JSON values; of None too.
    to_table : callable
        Returns it as a table.
    nobody : str
        The line if there is nobody.
    unreached : str, optional
        The line if nothing listens where it connects; that of the session if left out.
    """

    find: "Callable[[Session], Any]"
    to_dict: Callable[[Any], dict[str, Any]]
    to_table: "Callable[[Any], Table]"
    nobody: str
    unreached: str | None = None

    def show(self, found: Any, *, as_json: bool) -> bool:
        """Show it once; False if nobody reads it any more."""
        read = True
        if as_json:
            read = console.block(json.dumps(self.to_dict(found), allow_nan=False))
        elif found is not None:
            read = console.table(self.to_table(found))
        if found is None:
            console.notice(self.nobody)
        return read


def status(
    watch: Annotated[bool, typer.Option("--watch", help="Keep it up to date, until Ctrl-C.")] = False,
    wait: Wait = _WAIT_S,
    connect: Annotated[
        list[str] | None,
        typer.Option(
            help="Endpoint to connect to; tcp/127.0.0.1:7447 if left out. May be repeated.", metavar="ENDPOINT"
        ),
    ] = None,
    zenoh_config: ZenohConfig = None,
    namespace: Namespace = NAMESPACE,
    ros: RosDomain = None,
    as_json: Json = False,
) -> None:
    """Show what runs in a namespace.

    It lists every robot, controller, learner, recorder, replay and explorer; with --ros, every topic of a ROS domain
    with its types and nodes.

    Exit status 1, and a line, if none does. With --watch, status 0 whatever there was, also if nobody is there yet;
    --json then prints an object a second.
    """
    from pipeline.terminal.signals import until_stopped
    from recorders.errors import ConfigError, UnreachedError
    from recorders.wire.session import open_session

    session = session_config(None, connect, zenoh_config, listens=False, wait_s=0.0 if watch else wait)
    where = ", ".join(session.connect or session.listen)
    timeout_s = max(wait, _WAIT_S)
    if namespace != NAMESPACE and not of_settings("namespace") and ros is not None:
        if not of_settings("ros"):
            raise ConfigError("--namespace: expected none beside --ros: a ROS domain is shown as a whole")
        ros = None
    look = _at_namespace(namespace, where, timeout_s) if ros is None else _at_domain(ros, where, timeout_s)
    if watch:
        with until_stopped() as stopped, ExitStack() as stack:
            _watch(look, _finding(look, session, stack), stopped, as_json=as_json)
        return
    try:
        with open_session(session) as opened:
            found = look.find(opened)
    except UnreachedError as error:
        if as_json:
            console.block(json.dumps(look.to_dict(None)))
        console.notice(look.unreached or f"no node runs: {error}")
        raise typer.Exit(1) from None
    look.show(found, as_json=as_json)
    if found is None:
        raise typer.Exit(1)


def _at_namespace(namespace: str, where: str, timeout_s: float) -> _Look:
    """Return the look at our nodes of a namespace."""
    from pipeline.terminal.status_table import status_table
    from recorders.nodes.search import find_nodes
    from recorders.wire.keys.namespace import check_namespace

    check_namespace(namespace)
    return _Look(
        lambda session: find_nodes(session, namespace=namespace, timeout_s=timeout_s) or None,
        lambda found: {"nodes": [node.to_dict() for node in found or ()]},
        status_table,
        f"no node runs in namespace '{namespace}' at {where}",
    )


def _at_domain(domain: int, where: str, timeout_s: float) -> _Look:
    """Return the look at the graph of a ROS domain."""
    from pipeline.terminal.graph_table import graph_table
    from recorders.wire.keys.ros_graph import GraphView, find_graph

    def find(session: "Session") -> GraphView | None:
        """Return the graph; None if nobody is in it."""
        view = find_graph(session, domain, timeout_s=timeout_s)
        return view if view.tokens else None

    return _Look(
        find,
        lambda view: {"domain": domain, **(view or GraphView(())).to_dict()},
        graph_table,
        f"no node is in ROS domain {domain} at {where}; one is there once it runs with "
        f"RMW_IMPLEMENTATION=rmw_zenoh_cpp and ROS_DOMAIN_ID={domain}, and reaches the same router",
        f"no node is in ROS domain {domain}: nothing listens at {where}; start the router of rmw_zenoh there, "
        "`ros2 run rmw_zenoh_cpp rmw_zenohd`, or give another --connect",
    )


def _finding(look: _Look, session: "SessionConfig", stack: ExitStack) -> Callable[[], Any]:
    """Return what looks again and again: nobody is there as long as nobody listens where it connects."""
    from recorders.errors import UnreachedError
    from recorders.wire.session import open_session

    opened: Session | None = None

    def find() -> Any:
        """Look once."""
        nonlocal opened
        try:
            opened = opened or stack.enter_context(open_session(session))
        except UnreachedError:
            return None
        return look.find(opened)

    return find


def _watch(look: _Look, find: Callable[[], Any], stopped: Callable[[], bool], *, as_json: bool) -> None:
    """Show it again and again, as long as it is read: in place on a terminal, else one below the other."""
    import time

    from rich.console import Console
    from rich.live import Live
    from rich.text import Text

    if as_json or not sys.stdout.isatty():
        while not stopped() and look.show(find(), as_json=as_json):
            time.sleep(_EVERY_S)
        return
    with Live(console=Console(highlight=False), auto_refresh=False) as live:
        while not stopped():
            found = find()
            live.update(Text(look.nobody) if found is None else look.to_table(found), refresh=True)
            time.sleep(_EVERY_S)
