"""A controller that serves and records for long takes no more memory than one that has just begun."""

import threading
from pathlib import Path

import pytest
import zenoh
from episodes import write_episode
from processes import start, wait_for_line

from pipeline.learner.rules.reservoir.config import LearnerConfig
from pipeline.robot.config import load_robot
from pipeline.training.trainer import train
from recorders.cdr.codec import encode
from recorders.messages.message_types import PoseStamped
from recorders.messages.topics import JOINT_COMMANDS, LEFT_TARGET, RIGHT_TARGET
from recorders.nodes.search import find_nodes
from recorders.protocol.frames import live_attachment
from recorders.wire.keys.namespace import message_key
from recorders.wire.loopback import free_endpoint
from recorders.wire.session import SessionConfig, open_session
from replay.sources.schedule import Schedule

WARM_TICKS, TICKS = 50_000, 250_000
UNDER_WAY = 50  # ticks: commands are dropped where the way out is blocked
AT_MOST = 4  # bytes a tick; a log's index that is kept in memory takes some 30
WAIT_S = 120.0


@pytest.mark.campaign
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("options", [(), ("--record", "served.mcap")], ids=["serve", "record"])
def test_a_quarter_of_a_million_ticks_leave_nothing_in_the_memory(options: tuple[str, ...], tmp_path: Path) -> None:
    log = write_episode(tmp_path / "log.mcap", samples=30)
    train([log], schedule=Schedule(epochs=1), config=LearnerConfig(seed=2)).controller().save(tmp_path / "c.npz")
    endpoint = free_endpoint()
    room = threading.Semaphore(UNDER_WAY)
    with (
        open_session(SessionConfig(listen=(endpoint,))) as session,
        session.declare_subscriber(message_key("reenact", JOINT_COMMANDS), lambda command: room.release()),
        start("serve", "c.npz", "--connect", endpoint, *options, cwd=tmp_path) as process,
    ):
        wait_for_line(process, "controller serves")
        while not find_nodes(session, namespace="reenact"):  # its token comes behind its subscriptions
            assert process.poll() is None
        play(session, room, range(WARM_TICKS))
        before = anonymous_bytes(process.pid)
        play(session, room, range(WARM_TICKS, TICKS))
        grown = anonymous_bytes(process.pid) - before
        process.terminate()
        process.communicate(timeout=WAIT_S)
    assert grown < AT_MOST * (TICKS - WARM_TICKS)


def play(session: zenoh.Session, room: threading.Semaphore, stamps: range) -> None:
    """Put both targets under each stamp, no more of them under way than there is room for; all are answered."""
    centre = load_robot("asimo").input_centre
    hands = zip((LEFT_TARGET, RIGHT_TARGET), (centre[:3], centre[3:]), strict=True)
    topics = [(message_key("reenact", topic), hand) for topic, hand in hands]
    for stamp in stamps:
        assert room.acquire(timeout=WAIT_S)
        for key, hand in topics:
            session.put(
                key,
                encode(PoseStamped(stamp, hand)),
                attachment=live_attachment(stamp, stamp),
                congestion_control=zenoh.CongestionControl.BLOCK,
            )
    for _ in range(UNDER_WAY):
        assert room.acquire(timeout=WAIT_S)
    room.release(UNDER_WAY)


def anonymous_bytes(pid: int) -> int:
    """Memory of a process that no file backs."""
    lines = dict(line.split(":") for line in Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()[1:])
    return int(lines["Anonymous"].split()[0]) * 1024
