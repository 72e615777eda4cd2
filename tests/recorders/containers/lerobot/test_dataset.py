"""Datasets of LeRobot open as recordings: states are joints, actions commands or targets; others are refused."""

import json
import shutil
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from recorders.cdr.codec import decode
from recorders.containers.opening import open_log
from recorders.errors import LogError
from recorders.messages.message_types import Float64MultiArray, JointState, PoseStamped
from recorders.messages.topics import JOINT_COMMANDS, JOINT_STATES, hand_measured, hand_target

pa = pytest.importorskip("pyarrow")
pq = pytest.importorskip("pyarrow.parquet")

NAMES = ["shoulder_pan.pos", "elbow_flex.pos"]
LENGTHS = (4, 3)


def state(size: int = 2, names: Any = NAMES) -> dict[str, Any]:
    return {"dtype": "float32", "shape": [size], "names": names}


def value(frame: int, place: int) -> float:
    return frame * 0.25 + place


def write(folder: Path, features: dict[str, dict[str, Any]], *, fps: float = 30, **info: Any) -> Path:
    """Write a dataset as LeRobot's own writer does, with other features beside those that are numbers."""
    frames = [(episode, frame) for episode, length in enumerate(LENGTHS) for frame in range(length)]
    columns: dict[str, Any] = {
        "frame_index": [frame for _, frame in frames],
        "episode_index": [episode for episode, _ in frames],
    }
    for name, feature in features.items():
        if feature["dtype"] == "float32":
            size = feature["shape"][0]
            rows = [[value(index, place) for place in range(size)] for index in range(len(frames))]
            columns[name] = pa.array(rows, pa.list_(pa.float32(), size))
    (folder / "data/chunk-000").mkdir(parents=True)
    (folder / "meta").mkdir()
    pq.write_table(pa.table(columns), folder / "data/chunk-000/file-000.parquet")
    about = {"codebase_version": "v3.0", "fps": fps, "features": features, **info}
    (folder / "meta/info.json").write_text(json.dumps(about))
    return folder


def test_states_are_joints_and_actions_of_joints_commands(tmp_path: Path) -> None:
    """LeRobot names a joint `elbow_flex.pos` that the URDF of its arm names `elbow_flex`."""
    reader = open_log(write(tmp_path / "set", {"observation.state": state(), "action": state()}))
    assert reader.topics == {JOINT_COMMANDS: JointState.TYPE, JOINT_STATES: JointState.TYPE}
    assert reader.counts == {JOINT_COMMANDS: 7, JOINT_STATES: 7}
    for index, record in enumerate(reader.records(topics=[JOINT_STATES])):
        joints = decode(record.type, record.data)
        assert isinstance(joints, JointState)
        assert joints.name == ("shoulder_pan", "elbow_flex")
        assert joints.position.tolist() == [value(index, 0), value(index, 1)]
        assert joints.stamp_ns == record.log_time_ns


def test_frames_are_at_the_rate_and_episodes_apart(tmp_path: Path) -> None:
    reader = open_log(write(tmp_path / "set", {"observation.state": state()}))
    times = [record.log_time_ns for record in reader]
    apart = [later - earlier for earlier, later in pairwise(times)]
    assert times[:4] == [times[0] + round(frame * 10**9 / 30) for frame in range(4)]
    assert apart[3] > 50 * 10**9  # more than ten times the largest tolerance of an alignment
    assert times[4] % 10**9 == 0


def test_a_slice_is_that_of_the_whole(tmp_path: Path) -> None:
    reader = open_log(write(tmp_path / "set", {"observation.state": state(), "action": state()}))
    whole = list(reader)
    start, end = whole[4].log_time_ns, whole[-1].log_time_ns
    assert list(reader.records(start_ns=start, end_ns=end)) == [
        record for record in whole if start <= record.log_time_ns < end
    ]


def test_hands_are_poses(tmp_path: Path) -> None:
    hands = ["right.x", "right.y", "right.z", "tool.x", "tool.y", "tool.z", "tool.qx", "tool.qy", "tool.qz", "tool.qw"]
    features = {"observation.state": state(), "observation.hand.right": state(3), "action": state(10, hands)}
    reader = open_log(write(tmp_path / "set", features))
    assert reader.topics == {
        hand_measured("right"): PoseStamped.TYPE,
        hand_target("right"): PoseStamped.TYPE,
        hand_target("tool"): PoseStamped.TYPE,
        JOINT_STATES: JointState.TYPE,
    }
    pose = [decode(record.type, record.data) for record in reader.records(topics=[hand_target("tool")])][2]
    assert isinstance(pose, PoseStamped)
    assert [*pose.position, *pose.orientation] == [value(2, place) for place in range(3, 10)]


def test_other_actions_stay_numbers_and_images_are_named(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    video = {"dtype": "video", "shape": [480, 640, 3], "names": ["height", "width", "channels"]}
    features = {"observation.state": state(), "action": state(3, None), "observation.images.top": video}
    reader = open_log(write(tmp_path / "set", features))
    record = next(iter(reader.records(topics=["/action"])))
    numbers = decode(record.type, record.data)
    assert isinstance(numbers, Float64MultiArray)
    assert np.array_equal(numbers.data, [value(0, place) for place in range(3)])
    assert "observation.images.top (video)" in caplog.text


def older(folder: Path) -> Path:
    return write(folder, {"observation.state": state()}, codebase_version="v2.1")


def unnamed(folder: Path) -> Path:
    return write(folder, {"observation.state": state(names=None)})


def of_images(folder: Path) -> Path:
    return write(folder, {"observation.images.top": {"dtype": "video", "shape": [4, 4, 3], "names": None}})


def without_rate(folder: Path) -> Path:
    return write(folder, {"observation.state": state()}, fps=0)


def without_frames(folder: Path) -> Path:
    found = older(folder)
    shutil.rmtree(found / "data")
    (found / "meta/info.json").write_text('{"codebase_version": "v3.0", "fps": 30, "features": {}}')
    return found


def of_two_sizes(folder: Path) -> Path:
    found = write(folder, {"observation.state": state()})
    about = json.loads((found / "meta/info.json").read_text())
    about["features"]["observation.state"] = state(3, ["a", "b", "c"])
    (found / "meta/info.json").write_text(json.dumps(about))
    return found


def cut_off(folder: Path) -> Path:
    file = write(folder, {"observation.state": state()}) / "data/chunk-000/file-000.parquet"
    file.write_bytes(file.read_bytes()[:300])
    return folder


def out_of_order(folder: Path) -> Path:
    write(folder, {"observation.state": state()})
    file = folder / "data/chunk-000/file-000.parquet"
    table = pq.read_table(file)
    pq.write_table(table.take([1, 0, *range(2, 7)]), file)
    return folder


def with_columns(folder: Path, *columns: tuple[str, Any]) -> Path:
    """Write a dataset, and to its table columns beside its own or in place of them."""
    file = write(folder, {"observation.state": state()}) / "data/chunk-000/file-000.parquet"
    table = pq.read_table(file)
    replaced = {name for name, _ in columns if name in table.column_names}
    kept = [(name, table.column(name)) for name in table.column_names if name not in replaced]
    names, arrays = zip(*kept, *columns, strict=True)
    pq.write_table(pa.Table.from_arrays(list(arrays), names=list(names)), file)
    return folder


def of_huge_numbers(folder: Path) -> Path:
    return with_columns(folder, ("episode_index", pa.array([2**63 + 1] * 7, pa.uint64())))


def with_a_name_twice(folder: Path) -> Path:
    twice = pa.array([[0.0, 0.0]] * 7, pa.list_(pa.float32()))
    return with_columns(folder, ("observation.state", twice), ("observation.state", twice))


def no_json(folder: Path) -> Path:
    (older(folder) / "meta/info.json").write_text("[1, 2")
    return folder


@pytest.mark.parametrize(
    ("broken", "line"),
    [
        (older, r"expected a LeRobotDataset v3, found codebase_version 'v2.1'; .*convert_dataset_v21_to_v30"),
        (unnamed, "expected a name for each of its 2 joints, found none"),
        (of_images, "expected joints in observation.state, found observation.images.top"),
        (without_rate, "fps: expected frames a second, found 0"),
        (without_frames, "expected frames in data/chunk-000/file-000.parquet"),
        (of_two_sizes, "observation.state: expected 3 numbers in each frame"),
        (cut_off, "not a sound LeRobotDataset"),
        (out_of_order, "expected frames in order, found 0 of episode 0"),
        (of_huge_numbers, "not a sound LeRobotDataset"),
        (with_a_name_twice, "not a sound LeRobotDataset"),
        (no_json, "expected the description of a LeRobotDataset"),
    ],
)
def test_what_cannot_be_read_is_one_line(tmp_path: Path, broken: Callable[[Path], Path], line: str) -> None:
    folder = broken(tmp_path / "set")
    with pytest.raises(LogError, match=line) as raised:
        list(open_log(folder))
    assert "\n" not in str(raised.value)
