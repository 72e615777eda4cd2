"""The verb status."""

import json
import sys
from collections.abc import Callable
from contextlib import ExitStack
from typing import TYPE_CHECKING, Annotated

import typer

from pipeline.cli.options import Json
from pipeline.cli.sessions import NAMESPACE, Namespace, Wait, ZenohConfig, session_config
from pipeline.terminal import console

if TYPE_CHECKING:
    from recorders.nodes.status import NodeStatus
    from recorders.wire.session import Session, SessionConfig

_WAIT_S = 1.0  # whoever is there answers within milliseconds
_EVERY_S = 1.0


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
    as_json: Json = False,
) -> None:
    """Show what runs in a namespace.

    It lists every robot, controller, learner, recorder, replay and explorer.

    Exit status 1, and a line, if none does. With --watch, status 0 whatever there was, also if nobody is there yet;
    --json then prints an object a second.
    """
    from pipeline.terminal.signals import until_stopped
    from recorders.errors import UnreachedError
    from recorders.nodes.search import find_nodes
    from recorders.wire.keys.namespace import check_namespace
    from recorders.wire.session import open_session

    check_namespace(namespace)
    session = session_config(None, connect, zenoh_config, listens=False, wait_s=0.0 if watch else wait)
    nobody = f"no node runs in namespace '{namespace}' at {', '.join(session.connect or session.listen)}"
    if watch:
        with until_stopped() as stopped, ExitStack() as stack:
            _watch(_finding(session, namespace, stack), stopped, nobody, as_json=as_json)
        return
    try:
        with open_session(session) as opened:
            found = find_nodes(opened, namespace=namespace, timeout_s=max(wait, _WAIT_S))
    except UnreachedError as error:
        if as_json:
            _print_json([])
        console.notice(f"no node runs: {error}")
        raise typer.Exit(1) from None
    _show(found, nobody, as_json=as_json)
    if not found:
        raise typer.Exit(1)


def _finding(session: "SessionConfig", namespace: str, stack: ExitStack) -> "Callable[[], list[NodeStatus]]":
    """Return what finds the nodes again and again: none as long as nobody listens where it connects."""
    from recorders.errors import UnreachedError
    from recorders.nodes.search import find_nodes
    from recorders.wire.session import open_session

    opened: Session | None = None

    def find() -> "list[NodeStatus]":
        """Find the nodes once."""
        nonlocal opened
        try:
            opened = opened or stack.enter_context(open_session(session))
        except UnreachedError:
            return []
        return find_nodes(opened, namespace=namespace)

    return find


def _show(found: "list[NodeStatus]", nobody: str, *, as_json: bool) -> bool:
    """Show the nodes once; False if nobody reads it any more."""
    from pipeline.terminal.status_table import status_table

    read = True
    if as_json:
        read = _print_json(found)
    elif found:
        read = console.table(status_table(found))
    if not found:
        console.notice(nobody)
    return read


def _watch(find: "Callable[[], list[NodeStatus]]", stopped: Callable[[], bool], nobody: str, *, as_json: bool) -> None:
    """Show the nodes again and again, as long as they are read: in place on a terminal, else one below the other."""
    import time

    from rich.console import Console
    from rich.live import Live
    from rich.text import Text

    from pipeline.terminal.status_table import status_table

    if as_json or not sys.stdout.isatty():
        while not stopped() and _show(find(), nobody, as_json=as_json):
            time.sleep(_EVERY_S)
        return
    with Live(console=Console(highlight=False), auto_refresh=False) as live:
        while not stopped():
            found = find()
            live.update(status_table(found) if found else Text(nobody), refresh=True)
            time.sleep(_EVERY_S)


def _print_json(found: "list[NodeStatus]") -> bool:
    return console.block(json.dumps({"nodes": [node.to_dict() for node in found]}, allow_nan=False))
