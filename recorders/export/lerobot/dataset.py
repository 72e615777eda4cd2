"""Writing of a LeRobotDataset v3, the same bytes for the same frames; needs the extra `parquet`.

The format is that of LeRobot (Apache-2.0, https://github.com/huggingface/lerobot, `lerobot.datasets`).
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from recorders.errors import ConfigError, LogError
from recorders.export.lerobot.statistics import statistics
from recorders.files import disk
from recorders.files.anonymous_file import write_whole
from recorders.files.new_folder import whole_folder
from recorders.messages.validation import FloatArray
from recorders.reading.lerobot_info import INFO_FILE

VERSION = "v3.0"

_DATA = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
_EPISODES = "meta/episodes/chunk-000/file-000.parquet"
_TASKS = "meta/tasks.parquet"
_STATISTICS = "meta/stats.json"
_COUNTERS = {
    "timestamp": "float32",
    "frame_index": "int64",
    "episode_index": "int64",
    "index": "int64",
    "task_index": "int64",
}
_FLOAT = "float32"  # what LeRobot's policies compute in; numbers of sensors with a resolution are exact in it


@dataclass(frozen=True, eq=False)
class Dataset:
    """Frames of one rate.

    Attributes
    ----------
    fps : int
        Frames a second.
    robot : str
        Name of the robot.
    task : str
        What is done, in words.
    features : mapping of str to sequence of str
        Columns, and the names of the numbers of each.
    episodes : sequence of mapping
        By column, the numbers of each episode, shape (n, size).
    """

    fps: int
    robot: str
    task: str
    features: Mapping[str, Sequence[str]]
    episodes: Sequence[Mapping[str, FloatArray]]

    @property
    def lengths(self) -> list[int]:
        """Number of frames of each episode."""
        return [len(next(iter(episode.values()))) for episode in self.episodes]


def write_dataset(dataset: Dataset, out: Path) -> None:
    """Write a dataset to a new folder, which has its name once it is whole.

    Parameters
    ----------
    dataset : Dataset
        At least one episode of at least one frame.
    out : Path
        The folder to make.

    Raises
    ------
    ConfigError
        If the folder exists.
    LogError
        If it cannot be written.
    """
    if out.exists():
        raise ConfigError(f"{out} exists: choose another name for the folder")
    try:
        with whole_folder(out) as folder:
            for file in (_DATA.format(chunk_index=0, file_index=0), _EPISODES):
                disk.make_folders((folder / file).parent)
            _write(dataset, folder)
    except OSError as error:
        raise LogError(f"{out}: cannot be written: {error.strerror or error}") from error


def _write(dataset: Dataset, folder: Path) -> None:
    columns, rows, start = [], [], 0
    schema = pa.schema([(name, _type(name, shape)) for name, (_, shape, _) in _features(dataset).items()])
    with _parquet(folder / _DATA.format(chunk_index=0, file_index=0), schema) as table:
        for number, episode in enumerate(dataset.episodes):
            values = _with_counters(episode, number, start, dataset.fps)
            table.write_table(_table(values, schema))  # one group of rows an episode, as LeRobot has them
            rows.append(_episode_row(dataset, values, number, start))
            start = rows[-1]["dataset_to_index"]
            columns.append(values)
    _write_rows(folder / _EPISODES, rows)
    _write_rows(folder / _TASKS, [{"task_index": 0, "task": dataset.task}], index="task")
    whole = {name: statistics(np.concatenate([values[name] for values in columns])) for name in schema.names}
    _write_json(folder / _STATISTICS, whole)
    _write_json(folder / INFO_FILE, _information(dataset, start))


def _features(dataset: Dataset) -> dict[str, tuple[str, int, list[str] | None]]:
    """Return type, size and names of each column."""
    own = {name: (_FLOAT, len(names), list(names)) for name, names in dataset.features.items()}
    return {**own, **{name: (kind, 1, None) for name, kind in _COUNTERS.items()}}


def _information(dataset: Dataset, frames: int) -> dict[str, Any]:
    return {
        "codebase_version": VERSION,
        "robot_type": dataset.robot,
        "total_episodes": len(dataset.episodes),
        "total_frames": frames,
        "total_tasks": 1,
        "chunks_size": 1000,
        "data_files_size_in_mb": 100,
        "video_files_size_in_mb": 200,
        "fps": dataset.fps,
        "splits": {"train": f"0:{len(dataset.episodes)}"},
        "data_path": _DATA,
        "video_path": None,
        "features": {
            name: {"dtype": kind, "shape": [size], "names": names}
            for name, (kind, size, names) in _features(dataset).items()
        },
    }


def _with_counters(
    episode: Mapping[str, FloatArray], number: int, start: int, fps: int
) -> dict[str, NDArray[np.float32] | NDArray[np.int64]]:
    """Return the columns of an episode as they are written, shape (n, size) each."""
    values: dict[str, Any] = {name: numbers.astype(np.float32) for name, numbers in episode.items()}
    frames = np.arange(len(next(iter(values.values()))))[:, None]
    return values | {
        "timestamp": (frames / fps).astype(np.float32),
        "frame_index": frames,
        "episode_index": np.full_like(frames, number),
        "index": frames + start,
        "task_index": np.zeros_like(frames),
    }


def _episode_row(dataset: Dataset, values: Mapping[str, NDArray[Any]], number: int, start: int) -> dict[str, Any]:
    length = len(values["index"])
    found = {
        "episode_index": number,
        "tasks": [dataset.task],
        "length": length,
        "data/chunk_index": 0,
        "data/file_index": 0,
        "dataset_from_index": start,
        "dataset_to_index": start + length,
    }
    for name, numbers in values.items():
        found |= {f"stats/{name}/{kind}": row for kind, row in statistics(numbers).items()}
    return {**found, "meta/episodes/chunk_index": 0, "meta/episodes/file_index": 0}


def _type(name: str, size: int) -> pa.DataType:
    """Return the type of a column: a row of floats, or one number where there is but one."""
    if name in _COUNTERS:
        return pa.float32() if _COUNTERS[name] == _FLOAT else pa.int64()
    return pa.float32() if size == 1 else pa.list_(pa.float32(), size)


def _table(values: Mapping[str, NDArray[Any]], schema: pa.Schema) -> pa.Table:
    arrays = []
    for field in schema:
        numbers = pa.array(np.ascontiguousarray(values[field.name]).reshape(-1))
        is_row = pa.types.is_fixed_size_list(field.type)
        arrays.append(pa.FixedSizeListArray.from_arrays(numbers, field.type.list_size) if is_row else numbers)
    return pa.Table.from_arrays(arrays, schema=schema)


def _write_rows(path: Path, rows: Sequence[Mapping[str, Any]], *, index: str | None = None) -> None:
    """Write rows as a table; `index` is the column that pandas is to take for its index."""
    table = pa.table({name: [row[name] for row in rows] for name in rows[0]})
    if index is not None:
        table = table.replace_schema_metadata({"pandas": json.dumps(_for_pandas(table, index))})
    with _parquet(path, table.schema) as writer:
        writer.write_table(table)


def _for_pandas(table: pa.Table, index: str) -> dict[str, Any]:
    """Return what pandas keeps beside a table that it writes: its columns, and which of them is the index."""
    columns = [
        {
            "name": field.name,
            "field_name": field.name,
            "pandas_type": "unicode" if field.type == pa.string() else str(field.type),
            "numpy_type": "object" if field.type == pa.string() else str(field.type),
            "metadata": None,
        }
        for field in table.schema
    ]
    return {"index_columns": [index], "column_indexes": [], "columns": columns, "pandas_version": "2.0.0"}


@contextmanager
def _parquet(path: Path, schema: pa.Schema) -> Iterator[pq.ParquetWriter]:
    """Write a table, to the disk; raises OSError."""
    with disk.create(path) as file:
        writer = pq.ParquetWriter(file, schema, compression="snappy", use_dictionary=True)
        try:
            yield writer
            writer.close()
        finally:
            writer.is_open = False  # otherwise it tries again, and prints why it fails, when it is collected
        file.flush()
        disk.sync(file)


def _write_json(path: Path, value: Mapping[str, Any]) -> None:
    write_whole(path, (json.dumps(value, indent=4, ensure_ascii=False, allow_nan=False) + "\n").encode())
