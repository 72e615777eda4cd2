"""A recorder's memory stays where it is, however many messages it takes."""

import json
import time
from pathlib import Path

import numpy as np
import pytest
import zenoh
from processes import start, wait_for_line

from recorders.messages.message_types import JointState, PoseStamped
from recorders.messages.topics import JOINT_STATES, LEFT_TARGET, RIGHT_TARGET, SAMPLE_JOINTS
from recorders.nodes.keys import node_key
from recorders.reading.reader import LogReader
from recorders.wire.loopback import free_endpoint
from recorders.wire.publisher import TopicPublisher
from recorders.wire.session import SessionConfig, open_session

WARM_UP, STEPS, STEP = 40, 260, 4_000  # messages: in all 13 minutes at 1,458 a second


def resident(pid: int) -> int:
    """Return the memory of a process [bytes]."""
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    return next(int(line.split()[1]) * 1024 for line in lines if line.startswith("VmRSS:"))


def recorded(session: zenoh.Session) -> int:
    """Return how many messages the recorder has written; -1 before it answers."""
    answers = session.get(node_key("reenact", "recorder", "recorder", "status"), timeout=120.0)
    said = [json.loads(answer.ok.payload.to_bytes()) for answer in answers if answer.ok]
    return said[0]["counts"]["messages"] if said else -1


def await_recorded(session: zenoh.Session, count: int) -> None:
    while recorded(session) < count:
        time.sleep(0.05)


def publish(producer: TopicPublisher, first: int) -> None:
    joints = tuple(f"joint_{number}" for number in range(15))
    for number in range(first, first + STEP, 4):
        for topic in (LEFT_TARGET, RIGHT_TARGET):
            producer.publish(topic, PoseStamped(number, [0.1, 0.2, 0.3]), log_time_ns=number)
        for topic in (JOINT_STATES, SAMPLE_JOINTS):
            producer.publish(topic, JointState(number, joints, np.zeros(15)), log_time_ns=number)


@pytest.mark.campaign
def test_the_memory_of_a_recorder_has_no_slope(tmp_path: Path) -> None:
    endpoint = free_endpoint()
    with (
        open_session(SessionConfig(listen=(endpoint,))) as session,
        TopicPublisher(session) as producer,
        start("record", "--out", "log.mcap", "--connect", endpoint, cwd=tmp_path) as process,
    ):
        wait_for_line(process, "records reenact/**")
        await_recorded(session, 0)
        sizes = []
        for step in range(WARM_UP + STEPS):
            publish(producer, step * STEP)
            await_recorded(session, (step + 1) * STEP)  # so that none waits, which takes memory too
            sizes.append(resident(process.pid))
        process.terminate()
        assert process.wait(timeout=120) == 0
    slope = np.polyfit(np.arange(STEPS) * STEP, sizes[WARM_UP:], 1)[0]
    assert slope < 2.0, f"{slope:.1f} bytes a message"  # 18 with an index in memory: 1.6 MB a minute
    assert sum(LogReader(tmp_path / "log.mcap").counts.values()) == (WARM_UP + STEPS) * STEP
