"""Reads a Zenoh configuration file (JSON5): credentials, certificates, access control, endpoints."""

import json
import re
from functools import cache
from pathlib import Path
from typing import Any

import zenoh

from recorders.errors import WireError, file_reason
from recorders.files.regular_file import require_regular_file
from recorders.text.wording import line_text

_FILES = (
    "transport/auth/usrpwd/dictionary_file",
    "transport/link/tls/root_ca_certificate",
    "transport/link/tls/listen_private_key",
    "transport/link/tls/listen_certificate",
    "transport/link/tls/connect_private_key",
    "transport/link/tls/connect_certificate",
)
_SOURCE_LINE = re.compile(r"\s+at \S+\.rs:\d+\.?")  # where in Zenoh's own sources an error was raised
_INVALID = "correctly deserialized, but it is invalid"  # Zenoh's whole message
_SYNTAX_ERROR = re.compile(r"--> (\d+):(\d+)\n.*= (.+)", re.DOTALL)


def read_config(path: Path) -> zenoh.Config:
    """Read a configuration file; files that it names are looked up beside it, and must exist.

    Raises
    ------
    WireError
        If it cannot be read, is not a Zenoh configuration, or names a file that is not there.
    """
    require_regular_file(path, expected="a Zenoh configuration file", error=WireError)
    try:
        config = zenoh.Config.from_json5(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise WireError(f"{path}: expected a Zenoh configuration file: {file_reason(error)}") from error
    except (UnicodeDecodeError, zenoh.ZError) as error:
        raise WireError(f"{path}: not a Zenoh configuration (JSON5): {reason(error)}") from error
    for name in _FILES:
        _look_up(config, name, path)
    return config


def explicit_setting(config: zenoh.Config, name: str) -> Any:
    """Return a setting, or None if it is what Zenoh starts from anyway."""
    value = config.get_json(name)
    return None if value == _zenoh_default(name) else json.loads(value)


def endpoints(config: zenoh.Config, name: str, *, path: Path) -> tuple[str, ...]:
    """Return the endpoints that a file gives under `name`, which is `connect/endpoints` or `listen/endpoints`.

    Raises
    ------
    WireError
        If they are not a plain list.
    """
    found = explicit_setting(config, name) or []
    if not isinstance(found, list) or not all(isinstance(endpoint, str) for endpoint in found):
        raise WireError(f"{path}: {name}: expected a list of endpoints, found {found}")
    return tuple(found)


def reason(error: Exception) -> str:
    """Return Zenoh's description of a failure on one line, without places in its sources or quotes of the file."""
    text = _SOURCE_LINE.sub("", str(error))
    if _INVALID in text:
        return "a user needs a password and a password a user, or a number is out of range"
    if syntax := _SYNTAX_ERROR.search(text):
        line, column, expected = syntax.groups()
        return f"line {line}, column {column}: {expected.strip()}"
    return line_text(text) or type(error).__name__


def _look_up(config: zenoh.Config, name: str, path: Path) -> None:
    """Make the path of a file that the configuration names absolute."""
    named = json.loads(config.get_json(name))
    if named is None:
        return
    file = path.parent.absolute() / named
    if not file.is_file():
        raise WireError(f"{path}: {name}: there is no file {file}")
    config.insert_json5(name, json.dumps(str(file)))


@cache
def _zenoh_default(name: str) -> str:
    return str(zenoh.Config().get_json(name))
