"""The status of nodes: figures from monotonic clocks, found wherever they are, nobody's word taken for more."""

import json
import time
from collections.abc import Iterator
from contextlib import ExitStack
from typing import Any

import pytest
import zenoh
from hypothesis import given, settings
from hypothesis import strategies as st
from waiting import wait_until

from recorders.errors import WireError
from recorders.nodes.keys import NodeId, node_key, node_name, node_of
from recorders.nodes.search import MALFORMED, NO_ANSWER, find_nodes
from recorders.nodes.status import NodeMeter, NodeSource, NodeStatus, declared_node
from recorders.wire.loopback import free_endpoint
from recorders.wire.session import SessionConfig, open_session

ANNA = NodeId("learner", "anna")
GOOD = NodeStatus("learner", "anna", "learning", 2.5, {"ticks": 7}, {"ticks": 1.5}, {"p50": None}, {"state": "ab"})
ESCAPE = "\x1b[2J"


@pytest.fixture(scope="module")
def sessions() -> Iterator[tuple[zenoh.Session, zenoh.Session]]:
    endpoint = free_endpoint()
    with (
        open_session(SessionConfig(listen=(endpoint,))) as near,
        open_session(SessionConfig(connect=(endpoint,))) as far,
    ):
        yield near, far


def find(session: zenoh.Session, namespace: str) -> list[NodeStatus]:
    """Find the nodes of a namespace, all of which answer, however long that takes."""
    return find_nodes(session, namespace=namespace, timeout_s=120.0)


def source(counts: dict[str, int], *, name: str = "anna") -> NodeSource:
    return NodeSource("learner", name, state=lambda: "learning", counts=lambda: counts)


def test_a_status_reads_back_as_it_was_written() -> None:
    assert NodeStatus.from_json(ANNA, json.dumps(GOOD.to_dict()).encode()) == GOOD


@pytest.mark.parametrize(
    "changes",
    [
        {"kind": "robot"},
        {"name": "berta"},
        {"state": 5},
        {"state": "x" * 201},
        {"since_s": "long"},
        {"since_s": True},
        {"counts": [1]},
        {"counts": {"ticks": -1}},
        {"counts": {"ticks": 1.5}},
        {"counts": {"ticks": 2**64}},
        {"counts": {str(k): k for k in range(201)}},
        {"rates_hz": {"ticks": 1e300}},
        {"latency_us": {"p50": "fast"}},
        {"digests": {"state": None}},
        {"digests": {"s" * 201: ""}},
        {"more": 1},
    ],
)
def test_what_is_no_status_is_refused(changes: dict[str, Any]) -> None:
    with pytest.raises(WireError) as raised:
        NodeStatus.from_json(ANNA, json.dumps(GOOD.to_dict() | changes).encode())
    assert len(str(raised.value)) < 200


@pytest.mark.parametrize("data", [b"", b"[]", b"\xff", b"[" * 60_000, b'{"since_s": NaN}', b"1" * 5000])
def test_bytes_that_are_no_object_are_refused(data: bytes) -> None:
    with pytest.raises(WireError):
        NodeStatus.from_json(ANNA, data)


@pytest.mark.parametrize("number", ["NaN", "Infinity", "1e999"])
def test_a_number_that_is_none_is_refused(number: str) -> None:
    text = json.dumps(GOOD.to_dict()).replace("2.5", number)
    with pytest.raises(WireError, match="since_s"):
        NodeStatus.from_json(ANNA, text.encode())


@settings(max_examples=40)
@given(
    st.recursive(
        st.none() | st.booleans() | st.floats() | st.text(), lambda x: st.lists(x) | st.dictionaries(st.text(), x)
    )
)
def test_any_json_is_a_status_or_refused(value: object) -> None:
    for data in (value, dict.fromkeys(GOOD.to_dict(), value)):
        with pytest.raises(WireError):
            NodeStatus.from_json(ANNA, json.dumps(data).encode())


def test_rates_and_times_are_of_the_monotonic_clock(monkeypatch: pytest.MonkeyPatch) -> None:
    now_s, counts = 100.0, {"ticks": 50}
    monkeypatch.setattr(time, "monotonic", lambda: now_s)
    monkeypatch.setattr(time, "time", lambda: 1e9 - 7.0 * now_s)  # a wall clock that runs backwards
    meter = NodeMeter(source(counts))
    now_s, counts["ticks"] = 102.0, 54
    status = meter.status()
    assert (status.since_s, status.counts, status.rates_hz) == (2.0, {"ticks": 54}, {"ticks": 2.0})
    for _ in range(10):  # a minute ago is no longer of late
        meter.sample()
        now_s += 1.0
    assert meter.status().rates_hz == {"ticks": 0.0}


def test_a_flood_of_questions_makes_one_status(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[int] = []

    def latency_us() -> dict[str, float | None]:
        asked.append(1)
        return {}

    monkeypatch.setattr(time, "monotonic", lambda: 5.0)
    meter = NodeMeter(NodeSource("learner", "anna", state=lambda: "", counts=dict, latency_us=latency_us))
    assert len({id(meter.status()) for _ in range(1000)}) == 1
    assert len(asked) == 1


def test_every_node_is_found_from_either_end(sessions: tuple[zenoh.Session, zenoh.Session]) -> None:
    near, far = sessions
    with ExitStack() as stack:
        stack.enter_context(declared_node(near, source({"ticks": 3}), namespace="lab/a"))
        stack.enter_context(declared_node(far, source({"ticks": 4}, name="berta"), namespace="lab/a"))
        stack.enter_context(declared_node(far, source({}), namespace="lab/b"))
        for session in sessions:  # what one session declares reaches the other a moment later
            wait_until(lambda session=session: len(find(session, "lab/a")) == 2)  # type: ignore[misc]
            found = find(session, "lab/a")
            assert [(node.name, node.state, node.counts) for node in found] == [
                ("anna", "learning", {"ticks": 3}),
                ("berta", "learning", {"ticks": 4}),
            ]
    wait_until(lambda: find(near, "lab/a") == [])


def test_a_node_that_does_not_answer_is_listed_so(sessions: tuple[zenoh.Session, zenoh.Session]) -> None:
    near, far = sessions
    key = node_key("mute", *ANNA, "alive")
    with (
        near.liveliness().declare_token(key),
        near.declare_queryable(key.replace("alive", "status"), lambda query: None),
    ):
        (node,) = find_nodes(far, namespace="mute", timeout_s=0.2)
    assert (node.kind, node.name, node.state, node.counts) == (*ANNA, NO_ANSWER, {})


def test_whoever_answers_with_no_status_is_shown_as_such(sessions: tuple[zenoh.Session, zenoh.Session]) -> None:
    near, far = sessions
    forged = json.dumps(GOOD.to_dict() | {"state": [ESCAPE] * 5})
    answers = ["{}", forged, "x" * 100_000, json.dumps(GOOD.to_dict())]

    def answer(query: zenoh.Query) -> None:
        with query:
            for text in answers:
                query.reply(node_key("bad", *ANNA, "status"), text)
            query.reply_err("no")

    with near.declare_queryable(node_key("bad", *ANNA, "status"), answer):
        found = find(far, "bad")
    assert sorted(node.state.partition(":")[0] for node in found) == ["learning", *[MALFORMED] * 3]
    assert all(len(node.state) < 200 and ESCAPE not in node.state for node in found)


def test_more_answers_than_there_can_be_nodes_are_not_read(sessions: tuple[zenoh.Session, zenoh.Session]) -> None:
    near, far = sessions

    def answer(query: zenoh.Query) -> None:
        with query:
            for _ in range(3000):
                query.reply(node_key("many", *ANNA, "status"), "{}")

    with near.declare_queryable(node_key("many", *ANNA, "status"), answer):
        assert len(find(far, "many")) == 1000


@pytest.mark.parametrize(
    "key",
    ["lab/@node/learner/anna", "lab/@node/frog/anna/alive", "lab/@node/learner/a b/alive", "lab/x/@node/robot/r/alive"],
)
def test_a_key_of_no_node_is_told_from_one(key: str) -> None:
    assert node_of("lab", key) is None
    assert node_of("lab", node_key("lab", *ANNA, "alive")) == ANNA


@pytest.mark.parametrize("text", ["Panda / left*", "", "ünï", "a" * 300])
def test_any_text_makes_a_name(text: str) -> None:
    node = NodeId("robot", node_name(text))
    assert node_of("lab", node_key("lab", *node, "status")) == node
