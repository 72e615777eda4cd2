"""`demonstrate live --ros`: poses that a client of others publishes are the path, by whatever name they come."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from ros_peer import ros_peer
from waiting import wait_until

from pipeline.exploration.live_paths import ListenConfig, subscribe_paths
from recorders.messages.message_types import JointState, PoseStamped
from recorders.messages.topics import JOINT_STATES, RIGHT_TARGET
from recorders.rmw_zenoh.names import NodeName
from recorders.wire.keys.ros_keys import RosKeys
from recorders.wire.loopback import free_endpoint
from recorders.wire.session import SessionConfig

pytest.importorskip("zenoh_ros2_sdk")

DOMAIN = 12
PERIOD_NS = 100_000_000


def test_poses_of_a_client_of_others_are_the_path() -> None:
    endpoint = free_endpoint()
    keys = RosKeys(DOMAIN, NodeName.remapped("demonstration", "/", ["/pose:=/tracker/hand"]))
    config = ListenConfig(duration_s=0.5, idle_timeout_s=60.0, keys=keys)
    with ThreadPoolExecutor() as pool:
        shown = pool.submit(
            subscribe_paths,
            {RIGHT_TARGET: "right"},
            renames={"/pose": RIGHT_TARGET},
            session=SessionConfig(listen=(endpoint,)),
            config=config,
        )
        with ros_peer(endpoint, domain=DOMAIN) as peer:
            peer.ask("publisher", topic="/tracker/hand", type_name=PoseStamped.TYPE, name="tracker")
            peer.ask("publisher", topic=JOINT_STATES, type_name=JointState.TYPE, name="arm")
            wait_until(lambda: peer.ask("info", topic="/tracker/hand")["subscribers"])
            peer.publish(JOINT_STATES, JointState(1, ("a",), np.zeros(1)))
            for index in range(6):
                pose = PoseStamped((index + 1) * PERIOD_NS, np.array([0.3, -0.2, 0.5 + 0.01 * index]))
                peer.publish("/tracker/hand", pose)
            paths = shown.result(timeout=120)
    assert set(paths.paths) == {"right"}
    points = [[0.3, -0.2, 0.5 + 0.01 * index] for index in range(6)]
    assert paths.paths["right"].points.tolist() == points
    assert paths.paths["right"].times_s.tolist() == pytest.approx([0.0, 0.1, 0.2, 0.3, 0.4, 0.5])
