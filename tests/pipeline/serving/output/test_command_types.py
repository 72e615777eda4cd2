"""Commands leave as messages that a robot's controllers take: the same positions in each type, as ROS has them."""

import numpy as np
import pytest

from pipeline.serving.output.command_types import CommandFormat, CommandType
from recorders.cdr.codec import decode_as, encode
from recorders.cdr.types.joint_trajectory import JointTrajectory, TrajectoryPoint
from recorders.errors import ConfigError
from recorders.messages.message_types import Float64MultiArray, JointState

JOINTS = ("shoulder", "elbow", "wrist_1")
STAMP_NS = 3_000_000_007
POSITION = np.array([0.1, -0.0, 1e-300])


def test_a_joint_state_carries_stamp_and_names() -> None:
    command = CommandFormat().encoder(JOINTS)(STAMP_NS, POSITION)
    assert command == encode(JointState(STAMP_NS, JOINTS, POSITION))
    assert CommandFormat().topic == "/joint_commands"


@pytest.mark.parametrize(("reach_in_s", "expected_ns"), [(None, 100_000_000), (0.02, 20_000_000), (1e-9, 1)])
def test_a_trajectory_has_one_point_that_is_reached_in_time(reach_in_s: float | None, expected_ns: int) -> None:
    form = CommandFormat(CommandType.TRAJECTORY, reach_in_s=reach_in_s)
    command = form.encoder(JOINTS)(STAMP_NS, POSITION)
    assert command == encode(JointTrajectory(0, JOINTS, (TrajectoryPoint(expected_ns, POSITION),)))
    (point,) = decode_as(JointTrajectory, command).points
    assert point.positions.tobytes() == POSITION.tobytes()
    assert (form.topic, form.type_name) == (
        "/joint_trajectory_controller/joint_trajectory",
        "trajectory_msgs/msg/JointTrajectory",
    )


def test_a_point_takes_the_time_that_its_joints_need() -> None:
    """However soon it is asked to be reached: a controller that interpolates moves nothing faster."""
    encode_command = CommandFormat(CommandType.TRAJECTORY).encoder(JOINTS, least_ns=lambda: 3_200_000_001)
    (point,) = decode_as(JointTrajectory, encode_command(STAMP_NS, POSITION)).points
    assert point.time_from_start_ns == 3_200_000_001


def test_an_array_has_the_positions_in_the_order_of_the_joints() -> None:
    form = CommandFormat("float64-array", topic="/arm/commands")
    assert form.encoder(JOINTS)(STAMP_NS, POSITION) == encode(Float64MultiArray(POSITION))
    assert (form.topic, form.type_name) == ("/arm/commands", Float64MultiArray.TYPE)


@pytest.mark.parametrize(
    ("settings", "expected"),
    [
        ({"type": "twist"}, "--command-type: expected joint-state, trajectory, float64-array, found 'twist'"),
        ({"topic": "commands"}, "--command-topic: expected a topic such as /joint_commands, found 'commands'"),
        ({"reach_in_s": 1.0}, "--reach-in: expected --command-type trajectory, found joint-state"),
        ({"type": "trajectory", "reach_in_s": 0.0}, "--reach-in: expected a time above 0 s, found 0"),
        ({"type": "trajectory", "reach_in_s": float("nan")}, "--reach-in: expected a time above 0 s, found nan"),
    ],
)
def test_a_setting_that_is_none_is_one_line(settings: dict[str, object], expected: str) -> None:
    with pytest.raises(ConfigError) as error:
        CommandFormat(**settings)
    assert str(error.value) == expected
