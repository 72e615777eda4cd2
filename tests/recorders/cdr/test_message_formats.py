"""Message types: our own, and one from outside the package, which is logged, read, compared and shown as ours are."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import toy_message
from installed import installed
from toy_message import PointStamped
from typer.testing import CliRunner

from pipeline.cli.app import app
from recorders.cdr.codec import decode, decode_as, encode
from recorders.cdr.contract import MessageFormatContract
from recorders.cdr.message_format import FORMATS
from recorders.cdr.types import (
    clock,
    float64_multi_array,
    joint_state,
    joint_trajectory,
    pose_stamped,
    string,
    tf_message,
    transform_stamped,
)
from recorders.cdr.types.joint_trajectory import JointTrajectory, TrajectoryPoint
from recorders.errors import ConfigError, MessageError
from recorders.messages.message_types import (
    MESSAGE_TYPES,
    Clock,
    Dimension,
    Float64MultiArray,
    JointState,
    PoseStamped,
    String,
    TFMessage,
    TransformStamped,
)
from recorders.reading.reader import LogReader
from recorders.writing.writer import LogWriter

STAMP_NS = 3_000_000_007


@pytest.fixture(scope="module", autouse=True)
def registered(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Install the type."""
    entries = {"geometry_msgs/msg/PointStamped": "FORMAT"}
    with installed(tmp_path_factory.mktemp("site"), toy_message, FORMATS, group="reenact.messages", entries=entries):
        yield


class TestPointStamped(MessageFormatContract):
    format = toy_message.FORMAT
    examples = (PointStamped(STAMP_NS, np.arange(3.0)), PointStamped(0, np.array([-0.0, 1e-300, 7.0]), "base"))


class TestJointTrajectory(MessageFormatContract):
    format = joint_trajectory.FORMAT
    examples = (
        JointTrajectory(STAMP_NS, ("a", "bb"), (TrajectoryPoint(100_000_000, np.array([1.0, -0.0])),)),
        JointTrajectory(
            0,
            ("a",),
            (
                TrajectoryPoint(0, np.zeros(1), velocities=np.ones(1)),
                TrajectoryPoint(STAMP_NS, accelerations=np.full(1, 1e-300), effort=np.array([7.0])),
            ),
            frame_id="base",
        ),
        JointTrajectory(0, (), ()),
    )

    @pytest.mark.parametrize(
        ("points", "expected"),
        [
            (("point",), "expected TrajectoryPoint, found str"),
            ((TrajectoryPoint(0, np.zeros(3)),), r"points\[0\].positions: expected 2 values"),
        ],
    )
    def test_points_are_of_the_joints(self, points: tuple[Any, ...], expected: str) -> None:
        with pytest.raises(MessageError, match=expected):
            JointTrajectory(0, ("a", "b"), points)


class TestJointState(MessageFormatContract):
    format = joint_state.FORMAT
    examples = (
        JointState(STAMP_NS, ("a", "bc"), np.array([1.0, 2.0]), velocity=np.array([0.5, -0.5])),
        JointState(STAMP_NS, (), np.empty(0), frame_id="base"),
    )


class TestPoseStamped(MessageFormatContract):
    format = pose_stamped.FORMAT
    examples = (PoseStamped(STAMP_NS, np.arange(3.0)), PoseStamped(0, np.arange(3.0), frame_id=""))


class TestString(MessageFormatContract):
    format = string.FORMAT
    examples = (String("a"), String("Grüße"))


class TestFloat64MultiArray(MessageFormatContract):
    format = float64_multi_array.FORMAT
    examples = (Float64MultiArray(np.arange(6.0), dims=(Dimension("row", 2, 6),), data_offset=1), Float64MultiArray([]))


class TestTransformStamped(MessageFormatContract):
    format = transform_stamped.FORMAT
    examples = (TransformStamped(STAMP_NS, "a", "b", np.arange(3.0)), TransformStamped(0, "a", "c"))


class TestTFMessage(MessageFormatContract):
    format = tf_message.FORMAT
    examples = (TFMessage(()), TFMessage((TransformStamped(1, "a", "b"), TransformStamped(2, "b", "c"))))


class TestClock(MessageFormatContract):
    format = clock.FORMAT
    examples = (Clock(0), Clock(STAMP_NS))


def test_every_type_of_ours_has_a_format() -> None:
    ours = {name: FORMATS.find(name).message for name in FORMATS.names() if name in MESSAGE_TYPES}
    assert ours == MESSAGE_TYPES


def test_it_is_logged_read_and_compared(tmp_path: Path) -> None:
    for name, x in (("one.mcap", 1.0), ("other.mcap", 1.5)):
        with LogWriter(tmp_path / name, manifest={"kind": "test"}) as writer:
            writer.write("/contact", PointStamped(STAMP_NS, [x, 0.0, 0.0]), log_time_ns=STAMP_NS)
    (record,) = LogReader(tmp_path / "one.mcap")
    assert decode_as(PointStamped, record.data).point.tolist() == [1.0, 0.0, 0.0]
    arguments = ["diff", str(tmp_path / "one.mcap"), str(tmp_path / "other.mcap"), "--json"]
    found = CliRunner().invoke(app, arguments)
    first = json.loads(found.stdout)["first_divergence"]
    assert (found.exit_code, first["field"], first["a"], first["b"]) == (1, "point.x", "1.0", "1.5")
    assert CliRunner().invoke(app, [*arguments, "--ignore", "point"]).exit_code == 0


def test_what_is_not_registered_is_refused() -> None:
    class Stranger:
        TYPE = "std_msgs/msg/Empty"

    class Impostor:
        TYPE = String.TYPE

    for message in (Stranger(), Impostor()):
        with pytest.raises(MessageError, match="expected a message of a registered type, found "):
            encode(message)
    with pytest.raises(MessageError, match="expected one of rosgraph_msgs/msg/Clock, "):
        decode("toy_message", b"")
    with pytest.raises(ConfigError, match="expected a message type, one of rosgraph_msgs/msg/Clock, "):
        FORMATS.find("std_msgs/msg/Bool")
