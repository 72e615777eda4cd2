"""The episodes of an aligned log begin where the numbers of its ticks jump."""

from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from episodes import write_plain_episode

from recorders.messages.topics import COMMANDED_TICK
from recorders.reading.reader import LogReader
from recorders.writing.writer import LogWriter
from replay.sources.episodes import ALIGNMENT, WHOLE, Span, alignment_of, episode_spans
from replay.sources.schedule import Schedule
from replay.sources.scheduled import Replay

PERIOD_NS = 200_000_000
FOREVER_NS = WHOLE.end_ns


def numbered(path: Path, numbers: list[int], **manifest: Any) -> Path:
    """Write ticks whose messages carry these numbers."""
    records = list(LogReader(write_plain_episode(path.with_name(f"plain_{path.name}"), samples=len(numbers) - 1)))
    with LogWriter(path, manifest=manifest) as writer:
        for place, record in enumerate(records):
            writer.copy(record._replace(sequence=numbers[place // 3]))
    return path


@pytest.mark.parametrize(
    ("numbers", "starts"),
    [
        ([0, 1, 2, 3], [0]),
        ([5, 6, 7], [0]),
        ([0, 1, 3, 4], [0, 2]),
        ([0, 2, 4], [0, 1, 2]),
        ([7, 8, 3, 4], [0, 2]),
        ([1, 1, 2], [0, 1]),
    ],
)
def test_an_episode_begins_where_numbers_jump(tmp_path: Path, numbers: list[int], starts: list[int]) -> None:
    reader = LogReader(numbered(tmp_path / "log.mcap", numbers, alignment={"by": "hand"}))
    bounds = [start * PERIOD_NS for start in starts] + [FOREVER_NS]
    assert episode_spans(reader, COMMANDED_TICK) == [Span(*pair) for pair in pairwise(bounds)]
    replay = Replay([reader.path], Schedule(epochs=1))
    assert [episode.count for episode in replay.episodes] == [
        3 * (end - start) for start, end in zip(starts, [*starts[1:], len(numbers)], strict=True)
    ]
    assert [log.get(ALIGNMENT) for log in replay.offer().logs] == [{"by": "hand"}] + [None] * (len(starts) - 1)


def test_a_log_that_was_not_aligned_is_one(tmp_path: Path) -> None:
    reader = LogReader(numbered(tmp_path / "log.mcap", [0, 5, 9]))
    assert episode_spans(reader, COMMANDED_TICK) == [WHOLE]
    assert alignment_of(reader) is None
    assert ALIGNMENT not in Replay([reader.path], Schedule(epochs=1)).offer().logs[0]


@pytest.mark.parametrize(("size", "known"), [(0, True), (65526, True), (65527, False), (1 << 20, False)])
def test_an_account_that_is_none_or_too_long_counts_for_nothing(tmp_path: Path, size: int, known: bool) -> None:
    """Of 64 KiB it may be, as JSON."""
    reader = LogReader(numbered(tmp_path / "log.mcap", [0, 2], alignment={"by": "x" * size}))
    assert (alignment_of(reader) is not None) == known
    other = LogReader(numbered(tmp_path / "other.mcap", [0, 2], alignment="by hand"))
    assert alignment_of(other) is None
