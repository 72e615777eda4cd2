"""Kinds of files that are mixed up on a command line, known by their first bytes."""

from recorders.mcap_format.records import MAGIC
from recorders.text.wording import value_text

ZIP_MAGIC = b"PK\x03\x04"
"""First bytes of a zip archive, and so of a controller (.npz)."""

ROS1_MAGIC = b"#ROSBAG V2.0\n"
"""First bytes of a bag of ROS 1."""

SQLITE_MAGIC = b"SQLite format 3\0"
"""First bytes of an sqlite file, and so of a `.db3` of rosbag2."""

LOG_KIND = "a log (MCAP)"

_OTHERS = (
    (ZIP_MAGIC, "a zip archive, as a controller (.npz) is"),
    (ROS1_MAGIC[:8], "a bag of ROS 1, which `reenact convert` makes an MCAP file of"),
    (SQLITE_MAGIC[:8], "sqlite, which `reenact convert` makes an MCAP file of if it is a rosbag2 recording"),
    (b"\x28\xb5\x2f\xfd", "a file compressed with zstd; `zstd -d` decompresses it"),
    (b"\x1f\x8b", "a file compressed with gzip; `gunzip` decompresses it"),
    (b"BZh", "a file compressed with bzip2; `bunzip2` decompresses it"),
    (b"\xfd7zXZ", "a file compressed with xz; `unxz` decompresses it"),
    (b"\x04\x22\x4d\x18", "a file compressed with lz4; `lz4 -d` decompresses it"),
    (b"\x89HDF", "HDF5; write its joints and poses to MCAP with a library such as mcap-ros2-support"),
    (b"PAR1", "Parquet; write its joints and poses to MCAP with a library such as mcap-ros2-support"),
    (b"RRF2", "a recording of Rerun; record the topics themselves too, as with `reenact record`"),
)


def mixed_up_kind(begin: bytes) -> str | None:
    """Return the kind of file that begins so, for an error line; None for one that nobody mixes up with a log.

    Parameters
    ----------
    begin : bytes
        First bytes of the file, or all of them.
    """
    if begin.startswith(MAGIC):
        return LOG_KIND
    return next((kind for magic, kind in _OTHERS if begin.startswith(magic)), None)


def no_log_text(begin: bytes) -> str:
    """Return what was expected and found where a file that begins so, in at most 8 bytes, stands for a log."""
    if not begin:
        return "expected an MCAP file, found an empty one"
    kind = mixed_up_kind(begin)
    found = f"one that begins with {value_text(begin)}" + (f": {kind}" if kind else "")
    return f"expected an MCAP file, found {found}"
