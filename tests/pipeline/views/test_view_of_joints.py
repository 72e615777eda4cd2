"""A log without targets is shown: the robot, and its hands where its kinematics has them, or beside those measured."""

from pathlib import Path

import numpy as np
import pytest
from rerun_server import rows

from pipeline.robot.config import load_robot
from pipeline.robot.kinematics import Kinematics
from pipeline.views.view import view_log
from recorders.messages.message_types import JointState, PoseStamped
from recorders.messages.topics import JOINT_STATES, hand_measured
from recorders.rerun_scene.recording import Destination
from recorders.writing.writer import LogWriter

pytestmark = pytest.mark.extra


@pytest.mark.parametrize("measured", [False, True])
def test_a_log_of_joints_alone_is_shown_with_the_hands_of_its_robot(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, measured: bool
) -> None:
    """Beside them stand the hands as measured, where they are; else nothing is compared."""
    robot, path = load_robot("so101"), tmp_path / "log.mcap"
    hands = Kinematics(robot).hands(robot.comfort)
    with LogWriter(path, manifest={"kind": "recording"}, attachments={}) as writer:
        for step in range(1, 6):
            if measured:
                pose = PoseStamped(step * 10**8, hands[0] + [0.0, 0.0, step / 100.0])
                writer.write(hand_measured("hand"), pose, log_time_ns=step * 10**8)
            joints = JointState(step * 10**8, robot.joints, robot.comfort)
            writer.write(JOINT_STATES, joints, log_time_ns=step * 10**8)
    with caplog.at_level("INFO"):
        assert view_log(path, Destination(tmp_path / "log.rrd"), robot="so101") == 5
    reached = np.array(rows(tmp_path / "log.rrd", "/joints", "Scalars:scalars"))
    np.testing.assert_array_equal(reached, np.tile(robot.comfort, (5, 1)))
    errors = np.array(rows(tmp_path / "log.rrd", "/error/hand", "Scalars:scalars"))[:, 0]
    np.testing.assert_allclose(errors, np.arange(1.0, 6.0) if measured else np.zeros(5), atol=1e-9)
    assert ("hands as measured stand for them" if measured else "neither targets nor hands") in caplog.text
