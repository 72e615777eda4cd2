"""Rows hold a tick's messages as the codec would write them: hands and then joints, with numbers that rise."""

import numpy as np
import pytest

from pipeline.alignment.blocks import joints_kind, pose_kind
from pipeline.alignment.rows import ROW_HEAD, RowFormat
from pipeline.alignment.ticks import Source, Ticks
from recorders.cdr.codec import encode
from recorders.messages.message_types import JointState, PoseStamped
from recorders.messages.record import RecordedMessage

JOINTS = ("a", "bb", "ccc")
ARM = Source("/arm", "/sample/joint_states", joints_kind(JOINTS))
LEFT, RIGHT = (Source(f"/{side}", f"/hand/{side}/measured", pose_kind()) for side in ("left", "right"))
CLOCK = Source("/camera", "", pose_kind())
LAST_NS = 2**31 * 10**9 - 1


def ticks_of(sources: tuple[Source, ...], stamps: list[int], cuts: list[bool], seed: int) -> Ticks:
    generator = np.random.default_rng(seed)
    values = tuple(generator.uniform(-1.0, 1.0, (len(stamps), source.kind.size)) for source in sources)
    return Ticks(np.array(stamps), values, np.array(cuts))


def messages_of(source: Source, ticks: Ticks, rank: int) -> list[bytes]:
    rows = zip(ticks.stamps_ns.tolist(), ticks.values[rank], strict=True)
    if source is ARM:
        return [encode(JointState(stamp, JOINTS, row)) for stamp, row in rows]
    return [encode(PoseStamped(stamp, row[:3], orientation=row[3:])) for stamp, row in rows]


@pytest.mark.parametrize("sources", [(ARM,), (LEFT, RIGHT, ARM), (ARM, RIGHT, CLOCK, LEFT), (CLOCK, LEFT, ARM)])
def test_rows_are_the_messages_of_ticks(sources: tuple[Source, ...]) -> None:
    rows = RowFormat(sources, JOINTS)
    first = ticks_of(sources, [0, 1, 10**9 - 1], [False, False, True], 1)
    second = ticks_of(sources, [10**9, LAST_NS - 5, LAST_NS], [True, True, False], 2)
    written = rows.rows(first), rows.rows(second)
    assert [len(part) for part in written] == [3 * rows.size] * 2
    named = [source for source in sources if source.ours]
    order = sorted(named, key=lambda source: source is ARM)
    assert list(rows.topics.items()) == [(source.ours, source.kind.message.TYPE) for source in order]
    expected = []
    for ticks, numbers in ((first, (0, 1, 3)), (second, (5, 7, 8))):
        columns = {source.ours: messages_of(source, ticks, sources.index(source)) for source in order}
        for place, (stamp, number) in enumerate(zip(ticks.stamps_ns.tolist(), numbers, strict=True)):
            expected += [
                RecordedMessage(topic, rows.topics[topic], messages[place], number, stamp)
                for topic, messages in columns.items()
            ]
    assert [message for part in written for message in rows.records(part)] == expected
    assert rows.size == ROW_HEAD.size + sum(len(message.data) for message in expected[: len(order)])
    assert [ROW_HEAD.unpack_from(written[1], rows.size * place) for place in range(3)] == [
        (10**9, 5),
        (LAST_NS - 5, 7),
        (LAST_NS, 8),
    ]
