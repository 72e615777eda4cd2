"""The index of a log's chunks while the log is written: on the disk, as a recording of a day has millions of them."""

from collections.abc import Iterator
from pathlib import Path

from mcap.data_stream import RecordBuilder

from recorders.files import disk
from recorders.files.anonymous_file import AnonymousFile

_PIECE = 2**20  # bytes


class ChunkIndexFile:
    """Takes the place of the list in which the library's writer gathers its `ChunkIndex` records until the summary.

    In memory each takes a kilobyte, which is some 100 MB an hour of a busy recording; here they take none, and some
    100 bytes of the disk. Only the summary, when the log is finished, is put together in memory.

    Parameters
    ----------
    near : Path
        The log; the file stands beside it, without a name.

    Raises
    ------
    OSError
        From every method but `close`, if the file cannot be made, written or read.
    """

    def __init__(self, near: Path) -> None:
        self._file = AnonymousFile(near)

    def append(self, index: "EncodedRecords") -> None:
        """Take the index of one more chunk."""
        self._file.stream.write(index.data)

    def __iter__(self) -> Iterator["EncodedRecords"]:
        """Yield all records, many at once, each time as something that the library can have write itself."""
        self._file.stream.flush()
        place = 0
        while piece := disk.read_at(self._file.stream, _PIECE, place):
            yield EncodedRecords(piece)
            place += len(piece)

    def close(self) -> None:
        """Remove the file; raises nothing."""
        self._file.discard()


class EncodedRecords:
    """Records of the summary as bytes, in place of objects of the library.

    Parameters
    ----------
    data : bytes
        One record, or several.
    """

    def __init__(self, data: bytes) -> None:
        self.data = data

    def write(self, builder: RecordBuilder) -> None:
        """Write the records as they are."""
        builder.write(self.data)
