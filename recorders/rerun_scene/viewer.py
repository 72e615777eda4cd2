"""Rerun's viewer, started so that it listens on loopback only and sends nothing to anyone."""

import importlib.util
import ipaddress
import json
import os
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from urllib.parse import urlsplit

from recorders.errors import ConfigError, WireError
from recorders.loopback import HOST, free_port

_START_S = 20.0  # a cold start reads a program of 290 MB
_POLL_S = 0.05
_REACH_S = 2.0


def viewer_environment(config_home: Path) -> dict[str, str]:
    """Return environment variables under which Rerun's viewer and command line neither send nor keep usage data.

    A released Rerun has two switches, and this sets both: `analytics_enabled` in `rerun/analytics.json` under the
    user's configuration directory, which it writes there, switched on, if it finds none; and the variable `CI`, set to
    anything. `FORCE_RERUN_ANALYTICS` beats both, so it goes. A configuration directory of our own leaves the user's
    alone.

    Parameters
    ----------
    config_home : Path
        Existing directory that lives as long as the viewer; receives `rerun/analytics.json`.

    Returns
    -------
    dict
        A copy of this process's environment with these changes.
    """
    home = config_home.resolve()  # a relative XDG_CONFIG_HOME counts for nothing
    directory = home / "rerun"
    directory.mkdir(exist_ok=True)
    config_file = directory / "analytics.json"
    config = {
        "analytics_enabled": False,
        "analytics_id": "",
        "config_file_path": str(config_file),
        "data_dir_path": str(directory / "analytics"),
    }
    config_file.write_text(json.dumps(config), encoding="utf-8")
    inherited = {name: value for name, value in os.environ.items() if name != "FORCE_RERUN_ANALYTICS"}
    return inherited | {"CI": "1", "XDG_CONFIG_HOME": str(home)}


def viewer_command(port: int, *options: str) -> list[str]:
    """Return the command line of a viewer on loopback.

    Raises
    ------
    ConfigError
        The program is not there.
    """
    package = importlib.util.find_spec("rerun_cli")
    folder = Path(package.origin).parent if package is not None and package.origin is not None else Path()
    program = folder / "rerun"
    if not program.is_file():
        raise ConfigError("expected Rerun's viewer in the package rerun-sdk, found none; install it again")
    return [str(program), "--bind", HOST, "--port", str(port), *options]


def open_viewer() -> str:
    """Open the viewer's window; it outlives this process. Returns the URL at which it takes recordings.

    Raises
    ------
    ConfigError
        No window can be opened here.
    """
    if not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise ConfigError(_no_window("this machine has no display"))
    port = free_port()
    minder = subprocess.Popen(  # noqa: S603  # our own module, no shell
        [sys.executable, "-m", __name__, str(port)],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,  # Ctrl-C ends a verb, not the window
    )
    url = f"rerun+http://{HOST}:{port}/proxy"
    deadline = time.monotonic() + _START_S
    while not is_reachable(url):
        if minder.poll() is not None or time.monotonic() > deadline:
            minder.terminate()
            raise ConfigError(_no_window("the viewer did not start"))
        time.sleep(_POLL_S)
    return url


def check_url(url: str) -> str:
    """Return the URL of a viewer that runs on this machine, in its plain form.

    Raises
    ------
    ConfigError
        It is not such a URL, or of another machine.
    WireError
        Nothing takes recordings there.
    """
    host, port = _address(url)
    # Rerun reads a URL in its own way: what else may stand in one, such as a user, is not let through.
    plain = f"rerun+http://{f'[{host}]' if ':' in host else host}:{port}/proxy"
    if not port or url.lower() != plain:
        raise ConfigError(f"expected the URL of a viewer, such as rerun+http://{HOST}:9876/proxy, found {url!r:.100}")
    if not _is_loopback(host):
        raise ConfigError(f"expected a viewer on this machine, at localhost, {HOST} or [::1], found {url!r:.100}")
    if not is_reachable(plain):
        raise WireError(f"expected a viewer at {plain}, found none; start one with `rerun --bind {HOST}`")
    return plain


def is_reachable(url: str) -> bool:
    """Whether something listens at the URL."""
    try:
        with socket.create_connection(_address(url), timeout=_REACH_S):
            return True
    except OSError:
        return False


def _address(url: str) -> tuple[str, int]:
    """Host and port of a URL; empty and 0 where it has none."""
    try:
        parts = urlsplit(url)
        return parts.hostname or "", parts.port or 0
    except ValueError:
        return "", 0


def _is_loopback(host: str) -> bool:
    try:
        return host in ("localhost", "::1") or ipaddress.IPv4Address(host).is_loopback
    except ValueError:  # another name
        return False


def _no_window(why: str) -> str:
    """Report a viewer that cannot be opened, and the way around it: some verbs have no --save of their own."""
    return (
        f"cannot open a window: {why}; `reenact view LOG|CONTROLLER --save FILE.rrd` writes a recording to look at "
        "elsewhere"
    )


def _mind(port: int) -> int:
    """Run a viewer to its end, and take away the configuration that it had."""
    with tempfile.TemporaryDirectory() as home:
        command = viewer_command(port, "--expect-data-soon")
        return subprocess.run(command, env=viewer_environment(Path(home)), check=False).returncode  # noqa: S603


if __name__ == "__main__":
    sys.exit(_mind(int(sys.argv[1])))
