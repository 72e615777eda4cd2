"""The part of a large record that stays in its file, to be read in pieces by whoever needs it."""

from collections.abc import Iterator
from typing import BinaryIO, NamedTuple

from recorders.mcap_format.errors import cut_off

_PIECE = 2**20  # bytes


class Unread(NamedTuple):
    """Bytes of a file that were not read: the file, where they begin and how many they are [bytes]."""

    file: BinaryIO
    start: int
    size: int

    def pieces(self) -> Iterator[bytes]:
        """Yield the bytes piece by piece, without moving the file's position; raises DamagedLog if they are gone."""
        position, end = self.file.tell(), self.start + self.size
        for start in range(self.start, end, _PIECE):
            piece = self._at(start, min(_PIECE, end - start))
            self.file.seek(position)
            yield piece

    def read(self, start: int, size: int) -> bytes:
        """Return `size` bytes of the file from `start` on, its position unmoved; raises DamagedLog if they are gone."""
        position = self.file.tell()
        data = self._at(start, size)
        self.file.seek(position)
        return data

    def _at(self, position: int, size: int) -> bytes:
        self.file.seek(position)
        data = self.file.read(size)
        if len(data) < size:  # the file became shorter
            raise cut_off(position)
        return data
