"""The container LeRobotDataset v3: frames of joints and actions in Parquet; needs the extra `parquet`."""

import logging
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from recorders.cdr.codec import encode
from recorders.cdr.rosbags_types import schema_text
from recorders.containers.foreign_reader import ForeignReader
from recorders.containers.lerobot.columns import columns_of, left_out
from recorders.errors import LogError
from recorders.mcap_format.channels import DeclaredChannel
from recorders.messages.record import RecordedMessage
from recorders.messages.validation import FloatArray
from recorders.reading.lerobot_info import read_lerobot_info
from recorders.reading.raw_messages import FOREVER_NS
from recorders.text.once import OnceWarner
from recorders.text.wording import names_text

logger = logging.getLogger(__name__)
_once = OnceWarner(logger, limit=64)

BETWEEN_NS = 55 * 10**9
"""Time before each episode [ns]: a pause for every tolerance of an alignment, and no leap of the clock."""

_SECOND = 10**9
_END_NS = 2**31 * _SECOND  # no message has a stamp from here on
_ROWS = 4096  # at a time
_EPISODE, _FRAME = "episode_index", "frame_index"


class _Frames(NamedTuple):
    """Some frames of an episode: their times [ns], shape (n,), and the numbers of each column."""

    times_ns: list[int]
    values: dict[str, FloatArray]


class LeRobotDataset(ForeignReader):
    """Reader of the joints, hands and actions of a dataset, as messages of the times of their frames.

    The format counts time anew in each episode: episodes follow one another, each from a whole second, `BETWEEN_NS` or
    a little more after the one before.

    Raises
    ------
    LogError
        If it is of another version, has no joints with names, or cannot be read; from every method, too.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._info = read_lerobot_info(path)
        self._columns = columns_of(self._info, where=str(path))
        if others := left_out(self._info, self._columns):
            _once.warn(f"{path}: left out, as they are neither joints nor hands: {names_text(others, limit=300)}")

    @cached_property
    def channels(self) -> tuple[DeclaredChannel, ...]:
        """Every channel, with its schema."""
        return tuple(
            DeclaredChannel(column.topic, "cdr", schema=(column.type, "ros2msg", schema_text(column.type).encode()))
            for column in self._columns
        )

    @cached_property
    def counts(self) -> dict[str, int]:
        """The number of messages on each topic: as many as there are frames."""
        with self._sound():
            frames = sum(pq.read_metadata(file).num_rows for file in self._info.files)
        return dict.fromkeys((column.topic for column in self._columns), frames) if frames else {}

    def records(
        self,
        *,
        topics: Iterable[str] | None = None,
        start_ns: int = 0,
        end_ns: int = FOREVER_NS,
        file_order: bool = False,  # there is one order
    ) -> Iterator[RecordedMessage]:
        """Yield the messages: see `recorders.reading.reader.LogReader.records`."""
        wanted = None if topics is None else frozenset(topics)
        columns = [column for column in self._columns if wanted is None or column.topic in wanted]
        number = 0
        for frames in self._frames({column.feature: None for column in columns}):
            for place, time_ns in enumerate(frames.times_ns):
                number += 1
                if start_ns <= time_ns < end_ns:
                    for column in columns:
                        message = column.message(time_ns, frames.values[column.feature][place, column.places])
                        yield RecordedMessage(column.topic, column.type, encode(message), number, time_ns)

    def _frames(self, features: Iterable[str]) -> Iterator[_Frames]:
        """Yield the frames in order, those of one episode at a time."""
        names, episode, frame, start_ns, last_ns = list(features), -1, -1, 0, 0
        with self._sound():
            for batch in self._batches([_EPISODE, _FRAME, *names]):
                episodes, numbers = self._whole_numbers(batch, _EPISODE), self._whole_numbers(batch, _FRAME)
                values = {name: self._rows(batch, name) for name in names}
                times_ns: list[int] = []
                for of_episode, number in zip(episodes.tolist(), numbers.tolist(), strict=True):
                    if of_episode < episode or (of_episode == episode and number <= frame) or number < 0:
                        raise LogError(f"{self.path}: expected frames in order, found {number} of episode {of_episode}")
                    if of_episode > episode:
                        start_ns = (last_ns + BETWEEN_NS + _SECOND - 1) // _SECOND * _SECOND
                    episode, frame = of_episode, number
                    last_ns = start_ns + round(number * _SECOND / self._info.fps)
                    if last_ns >= _END_NS:
                        raise LogError(f"{self.path}: expected times up to 2^31 s, found frame {number} beyond")
                    times_ns.append(last_ns)
                yield _Frames(times_ns, values)

    def _batches(self, names: list[str]) -> Iterator[Any]:
        for file in self._info.files:
            with pq.ParquetFile(file) as table:
                if missing := [name for name in names if name not in table.schema_arrow.names]:
                    raise LogError(f"{file}: expected columns {names_text(missing)}, found none of these names")
                yield from table.iter_batches(batch_size=_ROWS, columns=names)

    def _whole_numbers(self, batch: Any, name: str) -> NDArray[np.int64]:
        column = batch.column(name)
        if not pa.types.is_integer(column.type) or column.null_count:
            raise LogError(f"{self.path}: {name}: expected whole numbers, found {column.type}")
        found: NDArray[np.int64] = column.cast(pa.int64()).to_numpy()
        return found

    def _rows(self, batch: Any, name: str) -> FloatArray:
        """Return the numbers of a column, shape (rows, size)."""
        column, size = batch.column(name), self._info.features[name].size
        kind = column.type
        numbers = column.flatten() if pa.types.is_list(kind) or pa.types.is_fixed_size_list(kind) else column
        if not pa.types.is_floating(numbers.type) or numbers.null_count or len(numbers) != len(column) * size:
            raise LogError(f"{self.path}: {name}: expected {size} numbers in each frame, found others ({kind})")
        found: FloatArray = numbers.cast(pa.float64()).to_numpy(zero_copy_only=False)
        return found.reshape(len(column), size)

    @contextmanager
    def _sound(self) -> Iterator[None]:
        try:
            yield
        except (
            pa.ArrowException,
            OSError,
            ValueError,
            KeyError,
        ) as error:
            raise LogError(f"{self.path}: not a sound LeRobotDataset: {str(error).splitlines()[0][:200]}") from None
