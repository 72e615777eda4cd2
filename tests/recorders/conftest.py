"""Small real logs and messages that the tests of this package share."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from recorders.cdr.codec import encode
from recorders.messages.message_types import (
    Clock,
    Dimension,
    Float64MultiArray,
    JointState,
    Message,
    PoseStamped,
    String,
    TFMessage,
    TransformStamped,
)
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import CLOCK, LEARNER_OUTPUT, LEFT_TARGET, RIGHT_TARGET, SAMPLE_JOINTS, SESSION_PHASE, TF
from recorders.writing.writer import LogWriter

NAMES = tuple(f"joint_{index:02d}" for index in range(15))
TICK_NS = 50_000_000
SIGNALLING_NAN = np.array([0x7FF0DEADBEEF0001], dtype=np.uint64).view(np.float64)


def tick_messages(tick: int) -> list[tuple[str, Message]]:
    """Return the messages of one tick, topic by topic."""
    stamp_ns = tick * TICK_NS
    angle = 0.1 * tick
    position = np.array([0.32, 0.2 + 0.01 * angle, 0.76])
    return [
        (LEFT_TARGET, PoseStamped(stamp_ns, position)),
        (RIGHT_TARGET, PoseStamped(stamp_ns, position * [1, -1, 1])),
        (SAMPLE_JOINTS, JointState(stamp_ns, NAMES, np.arange(15) / 7 + angle)),
        (TF, TFMessage((TransformStamped(stamp_ns, "world", "torso", position),))),
        (CLOCK, Clock(stamp_ns)),
        (SESSION_PHASE, String(f"tick {tick}")),
        (LEARNER_OUTPUT, Float64MultiArray(position, dims=(Dimension("hand", 3, 3),))),
    ]


@pytest.fixture(
    params=[
        JointState(0, (), np.empty(0)),
        JointState(1_500_000_000, ("a", "bcd"), np.array([1.0, 2.0])),
        JointState(2**31 * 10**9 - 1, NAMES, np.arange(15.0), velocity=-np.arange(15.0), frame_id="base"),
        JointState(7, ("a", "b", "c"), np.empty(0), effort=np.array([np.inf, SIGNALLING_NAN[0], -0.0])),
        JointState(8, ("a",), np.ones(1), velocity=np.ones(1), effort=np.ones(1), frame_id="Hüfte"),
        PoseStamped(3_000_000_001, np.array([0.1, 0.2, 0.3])),
        PoseStamped(4, np.ones(3), orientation=np.array([0.5, 0.5, -0.5, 0.5]), frame_id=""),
        String(""),
        String('{"run":"ü"}'),
        Float64MultiArray(np.empty(0)),
        Float64MultiArray(np.arange(3.0), dims=(Dimension("row", 1, 3), Dimension("x", 3, 3)), data_offset=2),
        TransformStamped(5, "world", "hand", np.arange(3.0), np.array([0.0, 1.0, 0.0, 0.0])),
        TFMessage(()),
        TFMessage((TransformStamped(5, "a", "b"), TransformStamped(6, "bc", "def", np.arange(3.0)))),
        Clock(123_456_789_012),
    ],
    ids=lambda message: type(message).__name__,
)
def message(request: pytest.FixtureRequest) -> Message:
    """Every message type, in layouts that pad differently."""
    found: Message = request.param
    return found


@pytest.fixture
def ticks() -> Callable[[int], list[RecordedMessage]]:
    """Return the records of the first n ticks, as a log would hold them."""

    def make(count: int) -> list[RecordedMessage]:
        return [
            RecordedMessage(topic, message.TYPE, encode(message), tick, tick * TICK_NS)
            for tick in range(count)
            for topic, message in tick_messages(tick)
        ]

    return make


@pytest.fixture
def write_log(tmp_path: Path) -> Callable[..., Path]:
    """Write a log of n ticks and return its path."""

    def write(count: int, name: str = "log.mcap") -> Path:
        path = tmp_path / name
        with LogWriter(path, manifest={"robot": "asimo", "seed": 3}, attachments={"robot.urdf": b"<robot/>"}) as log:
            for tick in range(count):
                for topic, message in tick_messages(tick):
                    log.write(topic, message, log_time_ns=tick * TICK_NS)
        return path

    return write


@pytest.fixture
def log(write_log: Callable[..., Path]) -> Path:
    """A log of 40 ticks, in several chunks."""
    return write_log(40)
