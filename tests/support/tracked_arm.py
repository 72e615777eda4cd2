"""Messages of an arm's joints and of a tracker on its hand, and the ticks that an aligner makes of them."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from pipeline.alignment.blocks import joints_kind, pose_kind
from pipeline.alignment.config import AlignmentConfig
from pipeline.alignment.frames import StaticFrames
from pipeline.alignment.rows import RowFormat
from pipeline.alignment.ticks import Aligner, Source
from recorders.cdr.codec import decode, encode
from recorders.messages.message_types import JointState, PoseStamped
from recorders.messages.record import RecordedMessage

MS = 10**6
START = 1_700_000_000 * 10**9
JOINTS = ("shoulder", "elbow")
SOURCES = (
    Source("/tracker", "/hand/right/measured", pose_kind()),
    Source("/joint_states", "/sample/joint_states", joints_kind(JOINTS)),
)


def joints(
    stamp: int, values: Iterable[float], names: Sequence[str] = JOINTS, log_time: int | None = None
) -> RecordedMessage:
    """Return the arm's joints at `stamp` [ns]."""
    message = JointState(stamp, tuple(names), np.array(values, dtype=float))
    return RecordedMessage("/joint_states", message.TYPE, encode(message), 0, stamp if log_time is None else log_time)


def pose(
    stamp: int, position: Sequence[float], orientation: Sequence[float] = (0.0, 0.0, 0.0, 1.0), frame: str = "world"
) -> RecordedMessage:
    """Return the tracker's pose at `stamp` [ns]."""
    message = PoseStamped(stamp, np.array(position), orientation=np.array(orientation), frame_id=frame)
    return RecordedMessage("/tracker", message.TYPE, encode(message), 0, stamp)


def aligned(
    records: Sequence[RecordedMessage],
    *,
    block: int = 8192,
    period: int | None = None,
    sources: tuple[Source, ...] = SOURCES,
    own: Sequence[str] = (),
    pivot: int = 0,
    **config: Any,
) -> tuple[Aligner, list[RecordedMessage]]:
    """Return an aligner that took `records` by the block, and the messages of its ticks."""
    aligner = Aligner(
        sources, AlignmentConfig(**config), period_ns=period, pivot=pivot, frames=StaticFrames(["", "world", *own])
    )
    made, rows = [], RowFormat(sources, JOINTS)
    for start in range(0, len(records), block):
        made += [rows.rows(ticks) for ticks in aligner.feed(records[start : start + block])]
    return aligner, list(rows.records(b"".join(made)))


def shifted(record: RecordedMessage, by_ns: int) -> RecordedMessage:
    """Return a message whose stamp is shifted [ns]."""
    message: Any = decode(record.type, record.data)
    return record._replace(data=encode(replace(message, stamp_ns=message.stamp_ns + by_ns)))


def steady(count: int = 100, **changes: Any) -> list[RecordedMessage]:
    """Return 100 Hz of joints and of a tracker, both moving."""
    return [
        record
        for index in range(count)
        for record in (
            joints(START + index * 10 * MS, (0.01 * index, 0.0)),
            pose(START + index * 10 * MS, (0.001 * index, 0.0, 0.0), **changes),
        )
    ]
