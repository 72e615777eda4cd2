"""A robot of other joints is told from the one that a controller or a learner is for."""

from collections.abc import Iterator
from contextlib import contextmanager

import pytest
import zenoh

from pipeline.robot_node.namespace_checks import RobotCheck
from pipeline.robot_node.protocol import RobotStatus, robot_key
from recorders.errors import JointError
from recorders.wire.loopback import free_endpoint
from recorders.wire.session import SessionConfig, open_session

JOINTS = ("turn", "rise")


@contextmanager
def answering(payload: bytes) -> Iterator[zenoh.Session]:
    """Yield a session in which somebody answers for the robot."""
    endpoint = free_endpoint()

    def answer(query: zenoh.Query) -> None:
        with query:
            query.reply(query.key_expr, payload)

    with (
        open_session(SessionConfig(listen=(endpoint,))) as robot,
        open_session(SessionConfig(connect=(endpoint,))) as s,
    ):
        with robot.declare_queryable(robot_key("lab", "status"), answer):
            while not list(s.get(robot_key("lab", "status"))):
                pass
            yield s


def status(*joints: str) -> bytes:
    return RobotStatus("berta", True, 0, 10**8, 0, 0, 0.0, joints=joints).to_json()


@pytest.mark.parametrize(
    ("joints", "controller", "learner"),
    [
        (("rise", "turn"), "", ""),
        ((), "", ""),  # it does not say
        (("rise", "turn", "finger"), "the controller lacks finger", ""),
        (("rise",), "it lacks turn", "it lacks turn"),
        (("rise", "spin"), "it lacks turn, the controller lacks spin", "it lacks turn, the learner lacks spin"),
    ],
)
def test_joints_are_compared_by_name(
    joints: tuple[str, ...], controller: str, learner: str, caplog: pytest.LogCaptureFixture
) -> None:
    with answering(status(*joints)) as session:
        for is_learner, expected in ((False, controller), (True, learner)):
            caplog.clear()
            check = RobotCheck(session, JOINTS, namespace="lab", learner=is_learner)
            check.warn()
            check.warn()
            assert len(caplog.messages) == bool(expected)
            assert all(
                f": {expected}; " in line and line.startswith("warning: robot 'berta'") for line in caplog.messages
            )
            if expected:
                with pytest.raises(JointError, match=expected):
                    check.check()
            else:
                check.check()


@pytest.mark.parametrize("payload", [b"", b"{}", b"[1]", b"x" * 100_000, status(*JOINTS).replace(b'"turn"', b"7")])
def test_whoever_answers_with_no_status_of_a_robot_is_passed_over(
    payload: bytes, caplog: pytest.LogCaptureFixture
) -> None:
    with answering(payload) as session:
        RobotCheck(session, ("turn",), namespace="lab").check()
    assert caplog.messages == []
