"""Poses are placed by the frames that `/tf_static` joins to the robot's world, whatever way, as rotations compose."""

import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pipeline.alignment import frames as module
from pipeline.alignment.frames import StaticFrames, mounted, placed
from recorders.cdr.codec import encode
from recorders.messages.message_types import TFMessage, TransformStamped
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import TF_STATIC

HERE = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)


def drawn(generator: np.random.Generator, *, length: float = 1.0) -> Any:
    """Return a pose whose quaternion has a length."""
    return (*generator.uniform(-1.0, 1.0, 3), *(length * Rotation.random(rng=generator).as_quat()))


def matrix(pose: Any) -> Any:
    found = np.eye(4)
    found[:3, :3], found[:3, 3] = Rotation.from_quat(pose[3:]).as_matrix(), pose[:3]
    return found


def static(*joins: tuple[str, str, Any]) -> RecordedMessage:
    """Return a message of (parent, child, pose of the child)."""
    transforms = tuple(
        TransformStamped(0, parent, child, np.array(pose[:3], dtype=float), np.array(pose[3:], dtype=float))
        for parent, child, pose in joins
    )
    return RecordedMessage(TF_STATIC, TFMessage.TYPE, encode(TFMessage(transforms)), 0, 1)


def assert_poses(found: Any, matrices: Any) -> None:
    for pose, expected in zip(found, matrices, strict=True):
        assert math.hypot(*pose[3:]) == pytest.approx(1.0, abs=1e-15)
        np.testing.assert_allclose(matrix(pose), expected, rtol=0, atol=1e-14)


@pytest.mark.parametrize("length", [1.0, 0.25, 3.0])
def test_poses_are_placed_in_a_frame_and_mounted_on_one(length: float) -> None:
    generator = np.random.default_rng(1)
    poses = np.array([drawn(generator) for _ in range(4)])
    other = drawn(generator, length=length)
    assert_poses(placed(other, poses), [matrix(other) @ matrix(pose) for pose in poses])
    assert_poses(mounted(poses, other), [matrix(pose) @ matrix(other) for pose in poses])


def test_poses_that_are_in_the_world_stay_what_they_are_to_the_bit_and_none_are_none() -> None:
    poses = np.array([[1.0, 2.0, 3.0, 0.1, 0.2, 0.3, 0.4]])
    assert placed(HERE, poses) is poses
    none = poses[:0]
    other = (1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 1.0)
    assert placed(other, none).shape == mounted(none, other).shape == (0, 7)


def test_frames_are_found_up_and_down_a_tree() -> None:
    """Of a chain map, odom, world, base, camera, lens the world is in the middle."""
    generator = np.random.default_rng(2)
    chain = ("map", "/odom", "world", "base", "/camera", "lens")
    joins = [(parent, child, drawn(generator, length=2.0)) for parent, child in pairwise(chain)]
    at, here = [np.eye(4)], np.eye(4)
    for _, _, pose in joins:
        here = here @ matrix(pose)
        at.append(here)
    frames = StaticFrames(["", "world"])
    assert [frames.find(name) for name in ("", "world", "/world")] == [HERE] * 3
    assert [frames.find(name) for name in ("map", "lens")] == [None, None]
    for join in reversed(joins):  # each in a message of its own, as launch files do
        frames.learn(static(join))
    for name, pose in zip(chain, at, strict=True):
        found = frames.find(name.lstrip("/"))
        assert found is not None
        np.testing.assert_allclose(matrix(found), np.linalg.inv(at[2]) @ pose, rtol=0, atol=1e-13)
    assert frames.find("lens2") is None
    frames.learn(static(("lens", "lens2", HERE), ("aside", "odd", HERE)))
    assert frames.find("/lens2") is not None
    assert (frames.find("aside"), frames.find("odd")) == (None, None)


def test_the_pose_of_a_frame_is_found_once(monkeypatch: pytest.MonkeyPatch) -> None:
    looks: list[int] = []

    def counted(transform: Any, poses: Any) -> Any:
        looks.append(1)
        return placed(transform, poses)

    monkeypatch.setattr(module, "placed", counted)
    frames = StaticFrames(["world"])
    frames.learn(static(("world", "base", HERE), ("base", "camera", HERE)))
    for _ in range(3):
        assert (frames.find("camera"), frames.find("base"), frames.find("map")) == (HERE, HERE, None)
    assert len(looks) == 3


def test_the_latest_transform_of_a_frame_counts() -> None:
    frames = StaticFrames(["world"])
    for x in (1.0, 2.0):
        frames.learn(static(("world", "camera", (x, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0))))
        assert frames.find("camera") == (x, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)


def test_transforms_that_are_none_are_passed_over_and_what_is_known_stays() -> None:
    frames = StaticFrames(["world"])
    good = (1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
    frames.learn(static(("world", "camera", good)))
    frames.learn(static(("world", "camera", HERE))._replace(data=b"\0\1\0\0cut"))
    bad = [(math.nan, *good[1:]), (*good[:6], math.inf), (*good[:3], 0.0, 0.0, 0.0, 0.0)]
    frames.learn(static(*[("world", "camera", pose) for pose in bad], ("world", "lamp", (0.0, 0.0, 0.0, 1.0, 0, 0, 0))))
    assert frames.find("camera") == good
    assert frames.find("lamp") is not None  # one number of a quaternion is enough


@pytest.mark.parametrize("circle", [("a", "b"), ("world", "a", "b"), ("a", "a")])
def test_frames_in_a_circle_end(circle: tuple[str, ...]) -> None:
    frames = StaticFrames(["world"])
    frames.learn(
        static(*[(parent, child, HERE) for parent, child in zip(circle, [*circle[1:], circle[0]], strict=True)])
    )
    assert (frames.find("a") is None) == (circle[0] != "world")
    assert frames.find("c") is None


def test_the_robots_world_is_found_by_any_of_its_names() -> None:
    frames = StaticFrames(["base", "world"])
    frames.learn(static(("map", "world", (1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)), ("dock", "base", HERE)))
    assert frames.find("map") == pytest.approx((-1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0))
    assert frames.find("dock") == pytest.approx(HERE)


def test_frames_from_anyone_fill_no_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_MAX_FRAMES", 3)
    frames = StaticFrames(["world"])
    frames.learn(static(*[("world", f"f{number}", HERE) for number in range(5)]))
    assert [frames.find(f"f{number}") is not None for number in range(5)] == [True] * 3 + [False] * 2
    for number in range(20):
        assert frames.find(f"unknown{number}") is None
        assert len(frames._found) <= 3
    assert frames.find("f0") == HERE
