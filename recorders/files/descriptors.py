"""File descriptors: there must be enough of them before libraries are called that abort, hang or lose without them."""

import resource
from pathlib import Path

from recorders.errors import ConfigError

_USUAL = 1024  # what a system gives by default


def need_descriptors(count: int, *, purpose: str) -> None:
    """Check that so many more files and connections can be opened; the soft limit is raised if it may be.

    Parameters
    ----------
    count : int
        How many.
    purpose : str
        What needs them, for the error.

    Raises
    ------
    ConfigError
        If this process may not have so many.
    """
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    opened = sum(1 for _ in Path("/proc/self/fd").iterdir()) - 1  # the listing itself is one
    wanted = max(_USUAL, opened + count)
    if 0 <= soft < wanted:
        soft = wanted if hard < 0 else max(soft, min(wanted, hard))
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
    if 0 <= soft < opened + count:
        raise ConfigError(
            f"{purpose} needs {count} file descriptors, expected a limit of at least {opened + count}, found {soft}: "
            f"raise it, as by `ulimit -n {_USUAL}`"
        )
