"""Kinds of files that are mixed up on a command line, known by their first bytes."""

from recorders.mcap_format.records import MAGIC
from recorders.text.wording import value_text

ZIP_MAGIC = b"PK\x03\x04"
"""First bytes of a zip archive, and so of a controller (.npz)."""

LOG_KIND = "a log (MCAP)"


def mixed_up_kind(begin: bytes) -> str | None:
    """Return the kind of file that begins so, for an error line; None if it is neither a log nor like a controller.

    Parameters
    ----------
    begin : bytes
        First bytes of the file, or all of them.
    """
    if begin.startswith(MAGIC):
        return LOG_KIND
    return "a zip archive, as a controller (.npz) is" if begin.startswith(ZIP_MAGIC) else None


def no_log_text(begin: bytes) -> str:
    """Return what was expected and found where a file that begins so, in at most 8 bytes, stands for a log."""
    if not begin:
        return "expected an MCAP file, found an empty one"
    kind = mixed_up_kind(begin)
    found = f"one that begins with {value_text(begin)}" + (f": {kind}" if kind else "")
    return f"expected an MCAP file, found {found}"
