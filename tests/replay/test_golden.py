"""The format of golden cases: what a case is made of, and what no case may do to whoever checks it."""

import json
import shutil
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from episodes import write_plain_episode

from recorders.errors import ConfigError
from recorders.messages import Message
from recorders.reader import LogReader
from recorders.ticks import join_ticks
from replay.golden import check_all, check_case, find_cases, summary
from replay.golden_add import add_case
from replay.golden_case import CASE_FILE, Tolerances, load_case
from replay.golden_log import CASE_TOPICS, slim
from replay.golden_physics import first_beyond
from replay.golden_recipe import EpochEnd, Moment, Recipe, State
from replay.schedule import Schedule


class CountingRunner:
    """A runner that learns nothing but how many ticks there were: golden checks know no learner."""

    def __init__(self, *, step: int = 1) -> None:
        self._step = step

    def learn(self, recipe: Recipe) -> Iterator[Moment | EpochEnd]:
        count = 0
        for epoch in range(recipe.schedule.epochs):
            for log in recipe.logs:
                for place, tick in enumerate(join_ticks(LogReader(log))):
                    count += self._step
                    digest = count.to_bytes(32, "little")
                    yield Moment(epoch, 0, "learn", log.name, place, tick.stamp_ns, b"s" * 32, b"o" * 32, digest)
            yield EpochEnd(epoch, {"count": np.array([float(count)])})

    def train(self, recipe: Recipe) -> dict[str, Any]:
        counts = [event.state["count"][0] for event in self.learn(recipe) if isinstance(event, EpochEnd)]
        return {"digest": str(counts[-1]), "errors_cm": counts}

    def simulate(self, log: Path, *, ticks: int) -> Iterator[tuple[str, Message]]:
        return iter(())

    def changed_robot(self, log: Path) -> str:
        return ""

    def pack(self, states: Sequence[State]) -> bytes:
        return json.dumps([state["count"].tolist() for state in states]).encode()

    def difference(self, packed: bytes, end: EpochEnd) -> tuple[str, str, str] | None:
        expected, found = json.loads(packed)[end.epoch], end.state["count"].tolist()
        return None if expected == found else ("count[0]", str(expected[0]), str(found[0]))


@pytest.fixture
def case(tmp_path: Path) -> Path:
    log = write_plain_episode(tmp_path / "log.mcap", samples=4)
    return add_case(tmp_path / "cases" / "a", Recipe((log,), {}, Schedule(epochs=2)), CountingRunner()).folder


def test_what_was_added_holds(case: Path) -> None:
    (verdict,) = check_all(case.parent, CountingRunner())
    assert summary([verdict]) == {
        "checked": 1,
        "failed": 0,
        "cases": [{"name": "a", "status": "passed", "tier": None, "first_divergence": None}],
    }
    assert find_cases(case) == [case]


def test_another_learner_is_named_by_tick_and_element(case: Path) -> None:
    finding = check_case(case, CountingRunner(step=2)).finding
    assert finding is not None
    assert (finding.tier, finding.field, finding.expected, finding.found) == ("learning", "count[0]", "5.0", "10.0")
    assert finding.place == {"epoch": 0, "cycle": 0, "phase": "learn", "log": "log.mcap", "tick": 0, "stamp_ns": 0}
    assert str(finding).startswith(
        "learning: epoch 0, cycle 0, phase learn, log log.mcap, tick 0, stamp_ns 0: count[0]"
    )


def test_an_added_case_is_the_same_wherever_it_was_made(case: Path, tmp_path: Path) -> None:
    again = add_case(tmp_path / "elsewhere" / "a", load_case(case).recipe, CountingRunner()).folder
    for path in case.iterdir():
        assert (again / path.name).read_bytes() == path.read_bytes()


def test_a_slim_log_is_copied_to_the_byte(tmp_path: Path) -> None:
    log = write_plain_episode(tmp_path / "log.mcap", samples=4)
    slim(log, tmp_path / "slim.mcap", physics=False)
    assert (tmp_path / "slim.mcap").read_bytes() == log.read_bytes()
    assert set(LogReader(log).topics) <= set(CASE_TOPICS)


def set_value(**values: Any) -> Callable[[dict[str, Any]], None]:
    return lambda table: table.update(values)


def set_log(**values: Any) -> Callable[[dict[str, Any]], None]:
    return lambda table: table["logs"][0].update(values)


BAD = (
    (set_value(format_version=2), "expected golden case format 1, found 2"),
    (set_value(format_version=True), "format_version is of the wrong type"),
    (set_value(logs=[]), "expected logs"),
    (set_value(logs=["log.mcap"]), "a log: expected name"),
    (set_value(extra=1), "the case: expected"),
    (set_value(schedule={"epochs": 10**9, "phases": [["learn", 1]]}), "epochs"),
    (set_value(schedule={"epochs": 7, "phases": [["learn", 1]]}), "at most 6 epochs"),
    (set_value(tolerances={"errors_cm": 1}), "tolerances: expected"),
    (set_value(tolerances={"errors_cm": float("nan"), "joints": 0, "hands_m": 0}), "tolerances: expected"),
    (set_value(tolerances={"errors_cm": float("inf"), "joints": 0, "hands_m": 0}), "tolerances: expected"),
    (set_value(resume_after=0), "at least 1 tick"),
    (set_log(name="../../etc/passwd"), "plain file name"),
    (set_log(name="/etc/passwd"), "plain file name"),
    (set_log(name="gone.mcap"), "gone.mcap"),
    (set_value(files={}), "expected SHA-256 None"),
)


@pytest.mark.parametrize(("change", "says"), BAD)
def test_a_bad_case_fails_and_says_why(case: Path, change: Callable[[dict[str, Any]], None], says: str) -> None:
    path = case / CASE_FILE
    table = json.loads(path.read_text())
    change(table)
    path.write_text(json.dumps(table))
    finding = check_case(case, CountingRunner()).finding
    assert finding is not None
    assert finding.tier == "case"
    assert says in str(finding)


@pytest.mark.parametrize("content", [b"", b"[]", b"\xff", b"{" * 100_000, b"[" * 100_000, b" " * (2 << 20)])
def test_no_content_of_a_case_file_hurts(case: Path, content: bytes) -> None:
    (case / CASE_FILE).write_bytes(content)
    finding = check_case(case, CountingRunner()).finding
    assert finding is not None
    assert finding.tier == "case"


@pytest.mark.parametrize("name", ["steps.bin", "states.npz", "log.mcap.index"])
def test_a_damaged_file_of_a_case(case: Path, name: str) -> None:
    for damage in (lambda path: path.write_bytes(path.read_bytes()[:-1]), lambda path: path.unlink()):
        copy = case.with_name("b")
        shutil.copytree(case, copy)
        damage(copy / name)
        finding = check_case(copy, CountingRunner()).finding
        assert finding is not None
        assert finding.tier == "case"
        assert name in str(finding)
        shutil.rmtree(copy)


def test_no_cases(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="expected golden cases"):
        find_cases(tmp_path)


def test_two_logs_of_one_name(tmp_path: Path) -> None:
    log = write_plain_episode(tmp_path / "log.mcap", samples=4)
    with pytest.raises(ConfigError, match="different names"):
        add_case(tmp_path / "a", Recipe((log, log), {}, Schedule(epochs=1)), CountingRunner())


def test_physics_is_compared_within_its_tolerance(tmp_path: Path) -> None:
    log = write_plain_episode(tmp_path / "log.mcap", samples=4)

    def made(shift: float) -> Iterator[tuple[str, Message]]:
        from dataclasses import replace

        from recorders.cdr import decode
        from recorders.messages import JointState

        for record in LogReader(log):
            message = decode(record.type, record.data)
            if isinstance(message, JointState) and message.stamp_ns:
                message = replace(message, position=message.position + shift)
            yield record.topic, message

    assert first_beyond(log, made(0.9e-3), Tolerances(joints=1e-3)) is None
    finding = first_beyond(log, made(1.1e-3), Tolerances(joints=1e-3))
    assert finding is not None
    assert finding.tier == "physics"
    assert finding.field == "position[0] (hip_height)"
    assert finding.place["topic"] == "/sample/joint_states"
    assert finding.place["sequence"] == 1
    nan = first_beyond(log, made(float("nan")), Tolerances(joints=1e-3))
    assert nan is not None
    assert nan.found == "nan"
