"""A LeRobotDataset holds frames, episodes and statistics as LeRobot's own loader and checks expect them."""

import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from recorders.errors import ConfigError
from recorders.messages.validation import FloatArray
from recorders.reading.lerobot_info import read_lerobot_info

pq = pytest.importorskip("pyarrow.parquet")

from recorders.export.lerobot.dataset import Dataset, write_dataset  # noqa: E402  # of an extra
from recorders.export.lerobot.statistics import statistics  # noqa: E402

JOINTS = ("shoulder", "elbow")


def dataset(lengths: tuple[int, ...] = (5, 3)) -> Dataset:
    draws = np.random.default_rng(0)
    episodes: list[Mapping[str, FloatArray]] = [
        {"observation.state": draws.normal(size=(length, 2)), "action": draws.normal(size=(length, 1))}
        for length in lengths
    ]
    return Dataset(10, "arm", "wave", {"observation.state": JOINTS, "action": ("elbow",)}, episodes)


def test_frames_are_numbered_through_and_within_their_episode(tmp_path: Path) -> None:
    made = dataset()
    write_dataset(made, tmp_path / "set")
    rows = pq.read_table(tmp_path / "set/data/chunk-000/file-000.parquet").to_pylist()
    assert [row["index"] for row in rows] == list(range(8))
    assert [(row["episode_index"], row["frame_index"]) for row in rows] == [
        *((0, frame) for frame in range(5)),
        *((1, frame) for frame in range(3)),
    ]
    assert [row["timestamp"] for row in rows[5:]] == np.array([0, 0.1, 0.2], np.float32).tolist()
    states = np.concatenate([episode["observation.state"] for episode in made.episodes])
    assert [row["observation.state"] for row in rows] == states.astype(np.float32).tolist()
    assert isinstance(rows[0]["action"], float)  # a row of one number is a number


def test_episodes_name_their_frames_and_carry_statistics(tmp_path: Path) -> None:
    made = dataset()
    write_dataset(made, tmp_path / "set")
    first, second = pq.read_table(tmp_path / "set/meta/episodes/chunk-000/file-000.parquet").to_pylist()
    assert (first["dataset_from_index"], first["dataset_to_index"], first["length"]) == (0, 5, 5)
    assert (second["dataset_from_index"], second["dataset_to_index"], second["tasks"]) == (5, 8, ["wave"])
    states = made.episodes[1]["observation.state"].astype(np.float32).astype(np.float64)
    assert second["stats/observation.state/max"] == states.max(axis=0).tolist()
    assert second["stats/observation.state/count"] == [3]
    whole = json.loads((tmp_path / "set/meta/stats.json").read_text())
    assert whole["index"]["max"] == [7]
    assert whole["observation.state"]["count"] == [8]


def test_the_task_is_what_pandas_takes_for_the_index(tmp_path: Path) -> None:
    write_dataset(dataset(), tmp_path / "set")
    table = pq.read_table(tmp_path / "set/meta/tasks.parquet")
    assert table.to_pylist() == [{"task_index": 0, "task": "wave"}]
    assert json.loads(table.schema.metadata[b"pandas"])["index_columns"] == ["task"]


def test_statistics_are_those_of_numpy() -> None:
    values = np.random.default_rng(1).normal(size=(101, 3))
    found = statistics(values)
    assert np.allclose(found["mean"], values.mean(axis=0), rtol=0, atol=1e-15)
    assert np.allclose(found["std"], values.std(axis=0), rtol=1e-14)
    for name, part in (("q01", 0.01), ("q10", 0.1), ("q50", 0.5), ("q90", 0.9), ("q99", 0.99)):
        assert np.allclose(found[name], np.quantile(values, part, axis=0), rtol=1e-14)


def test_the_same_frames_are_the_same_bytes(tmp_path: Path) -> None:
    for name in ("one", "two"):
        write_dataset(dataset(), tmp_path / name)
    files = [path.relative_to(tmp_path / "one") for path in sorted((tmp_path / "one").rglob("*.*"))]
    assert len(files) == 5
    for file in files:
        assert (tmp_path / "one" / file).read_bytes() == (tmp_path / "two" / file).read_bytes()


def test_a_folder_that_is_there_stays(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="exists: choose another name"):
        write_dataset(dataset(), tmp_path)


def test_what_is_written_is_described(tmp_path: Path) -> None:
    write_dataset(dataset(), tmp_path / "set")
    info = read_lerobot_info(tmp_path / "set")
    assert info.fps == 10
    assert info.features["observation.state"].names == JOINTS
    assert info.files == (tmp_path / "set/data/chunk-000/file-000.parquet",)
