"""The format of golden cases: what a case is made of, and what no case may do to whoever checks it."""

import hashlib
import itertools
import json
import shutil
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from counting_runner import CountingRunner
from episodes import write_plain_episode

from recorders.cdr.codec import decode
from recorders.errors import ConfigError, LogError
from recorders.files import disk
from recorders.messages.message_types import JointState, Message
from recorders.messages.topics import COMMANDED_TICK
from recorders.reading.reader import LogReader
from replay.golden.add import add_case
from replay.golden.case import Tolerances, load_case
from replay.golden.check import check_all, check_case, summary
from replay.golden.finding import ElementDifference, Finding
from replay.golden.folder import CASE_FILE, find_cases
from replay.golden.log_tier import LogIndex, strip_topics
from replay.golden.physics_tier import first_beyond
from replay.golden.recipe import CaseSpec, EpochEnd, TickDigests
from replay.sources.schedule import Schedule


@pytest.fixture
def case(tmp_path: Path) -> Path:
    log = write_plain_episode(tmp_path / "log.mcap", samples=4)
    return add_case(tmp_path / "cases" / "a", CaseSpec((log,), {}, Schedule(epochs=2)), CountingRunner()).folder


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
    assert (finding.tier, finding.field) == ("learning", "state")
    assert (finding.expected, finding.found) == ("digest 01000000", "digest 02000000")
    assert finding.epoch_end == ElementDifference(0, "count[0]", "5.0", "10.0")
    assert finding.place == {"epoch": 0, "cycle": 0, "phase": "learn", "log": "log.mcap", "tick": 0, "stamp_ns": 0}
    assert str(finding).startswith(
        "learning: epoch 0, cycle 0, phase learn, log log.mcap, tick 0, stamp_ns 0: state: expected "
    )


def test_an_added_case_is_the_same_wherever_it_was_made(case: Path, tmp_path: Path) -> None:
    again = add_case(tmp_path / "elsewhere" / "a", load_case(case).recipe, CountingRunner()).folder
    for path in case.iterdir():
        assert (again / path.name).read_bytes() == path.read_bytes()


def test_a_slim_log_is_copied_to_the_byte(tmp_path: Path) -> None:
    log = write_plain_episode(tmp_path / "log.mcap", samples=4)
    strip_topics(log, tmp_path / "slim.mcap", physics=False)
    assert (tmp_path / "slim.mcap").read_bytes() == log.read_bytes()
    assert set(LogReader(log).topics) <= set(LogIndex(COMMANDED_TICK).topics)


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
    (set_value(files={}), "files: expected the SHA-256 of steps.bin, states.npz, log.mcap.index, found a table of 0"),
    (set_value(files={"../../../log.mcap": "0" * 64}), "files: expected the SHA-256 of steps.bin"),
    (set_value(files=dict.fromkeys(("steps.bin", "states.npz", "log.mcap.index"), 1)), "files: expected the SHA-256"),
    (set_value(history=["x"]), "history: expected entries with reason and digest, found 'x'"),
    (set_value(history=[{"reason": "x", "digest": 1}]), "history: expected entries with reason and digest"),
    (set_value(history=[{"reason": "x", "digest": "x"}]), "history: expected the digest of its last entry to be '10"),
    (set_value(history=[]), "history: expected the digest of its last entry to be '10.0', found nothing"),
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


def rehash(case: Path, name: str, data: bytes) -> None:
    """Change a file of a case, and its hash with it."""
    (case / name).write_bytes(data)
    values = json.loads((case / CASE_FILE).read_text())
    values["files"][name] = hashlib.sha256(data).hexdigest()
    (case / CASE_FILE).write_text(json.dumps(values))


@pytest.mark.parametrize(
    ("name", "change", "says"),
    [
        ("steps.bin", lambda data: data + b"12345", "steps.bin: expected a multiple of 12 bytes, found 125"),
        ("log.mcap.index", lambda data: data[:14], "log.mcap.index: expected entries of 13 bytes"),
        ("log.mcap.index", lambda data: b"\xff" + data[1:], "log.mcap.index: expected entries of 13 bytes"),
    ],
)
def test_a_file_of_the_wrong_form(case: Path, name: str, change: Callable[[bytes], bytes], says: str) -> None:
    rehash(case, name, change((case / name).read_bytes()))
    finding = check_case(case, CountingRunner()).finding
    assert finding is not None
    assert finding.tier == "case"
    assert says in str(finding)


@pytest.mark.parametrize("name", [CASE_FILE, "steps.bin", "log.mcap"])
def test_a_folder_in_place_of_a_file(case: Path, name: str) -> None:
    (case / name).unlink()
    (case / name).mkdir()
    finding = check_case(case, CountingRunner()).finding
    assert finding is not None
    assert finding.tier == "case"
    assert f"{name}: expected a file" in str(finding)


def test_a_path_is_named_once(case: Path) -> None:
    (case / CASE_FILE).unlink()
    finding = check_case(case, CountingRunner()).finding
    assert str(finding).count(CASE_FILE) == 1


class CrashingRunner(CountingRunner):
    """Crashes where it is told to."""

    def __init__(self, where: str) -> None:
        super().__init__()
        self._where = where

    def learn(self, recipe: CaseSpec) -> Iterator[TickDigests | EpochEnd]:
        yield from itertools.islice(super().learn(recipe), 3 if self._where == "learn" else None)
        if self._where == "learn":
            raise ZeroDivisionError("a step")

    def train(self, recipe: CaseSpec) -> dict[str, Any]:
        if self._where == "train":
            raise KeyError("digest")
        return super().train(recipe)

    def simulate(self, log: Path, *, ticks: int) -> Iterator[tuple[str, Message]]:
        raise RuntimeError("no\nrobot")


@pytest.mark.parametrize(
    ("where", "tier", "tick", "says"),
    [
        ("learn", "learning", 2, "found ZeroDivisionError at test_golden.py:"),
        ("train", "learning", None, "found KeyError at test_golden.py:"),
        ("simulate", "physics", None, ": no robot"),
    ],
)
def test_a_program_that_crashes(case: Path, where: str, tier: str, tick: int | None, says: str) -> None:
    values = json.loads((case / CASE_FILE).read_text())
    values["physics"] = True
    (case / CASE_FILE).write_text(json.dumps(values))
    finding = check_case(case, CrashingRunner(where)).finding
    assert finding is not None
    assert (finding.tier, finding.place.get("tick")) == (tier, tick)
    assert says in str(finding)


def test_a_failure_says_what_changed_in_the_environment(case: Path) -> None:
    values = json.loads((case / CASE_FILE).read_text())
    present = values["environment"]["packages"]["numpy"]
    values["environment"]["packages"]["numpy"] = "1.0"
    (case / CASE_FILE).write_text(json.dumps(values))
    assert check_case(case, CountingRunner()).finding is None
    finding = check_case(case, CountingRunner(step=2)).finding
    assert finding is not None
    assert finding.environment == (f"numpy 1.0, now {present}",)
    assert f"the case was made with numpy 1.0, now {present}" in str(finding)


def test_control_signs_are_spelled_out() -> None:
    assert str(Finding("case", "file", "a", "b\x1b[31m\n")) == "case: file: expected a, found b\\x1b[31m\\n"


def test_cases_are_found_at_any_depth(case: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    golden = case.parent
    shutil.copytree(case, golden / "arms" / "build" / "b")
    shutil.copytree(case, golden / ".hidden" / "c")
    (golden / "loop").symlink_to(golden)
    assert [verdict.name for verdict in check_all(golden, CountingRunner())] == ["a", "arms/build/b"]
    monkeypatch.chdir(case)
    (verdict,) = check_all(Path(), CountingRunner())
    assert verdict.name == "a"


def test_a_link_out_of_the_tree_is_not_followed(case: Path, tmp_path: Path) -> None:
    elsewhere = tmp_path / "elsewhere"
    shutil.copytree(case, elsewhere / "b")
    golden = case.parent
    (golden / "link").symlink_to(elsewhere)
    with pytest.raises(ConfigError, match=r"link: expected a folder within .* found a link that leads out of it"):
        find_cases(golden)
    (golden / "link").unlink()
    (golden / "again").symlink_to(case)
    assert [path.name for path in find_cases(golden)] == ["a", "again"]


@pytest.mark.parametrize("name", [CASE_FILE, "steps.bin", "log.mcap"])
def test_a_file_of_a_case_is_no_link_out_of_the_tree(case: Path, tmp_path: Path, name: str) -> None:
    (case / name).rename(tmp_path / name)
    (case / name).symlink_to(tmp_path / name)
    finding = check_case(case, CountingRunner()).finding
    assert finding is not None
    assert finding.tier == "case"
    assert "found a link that leads elsewhere" in finding.found


class Interrupt(BaseException):
    """What Ctrl-C raises, but not it: pytest would stop."""


@pytest.mark.parametrize("error", [OSError("full"), Interrupt()])
@pytest.mark.parametrize("at", [1, 2])
def test_a_replacement_that_fails_leaves_the_case(
    case: Path, monkeypatch: pytest.MonkeyPatch, error: BaseException, at: int
) -> None:
    right, calls = disk.rename, itertools.count(1)

    def rename(old: Path, new: Path) -> None:
        if old.is_dir() and next(calls) == at:
            raise error
        right(old, new)

    before = {path.name: path.read_bytes() for path in case.iterdir()}
    with monkeypatch.context() as patch:
        patch.setattr(disk, "rename", rename)
        with pytest.raises((LogError, Interrupt)):
            add_case(case, replace(load_case(case).recipe, schedule=Schedule(epochs=1)), CountingRunner(), reason="x")
    assert {path.name: path.read_bytes() for path in case.iterdir()} == before
    assert list(case.parent.iterdir()) == [case]


def test_a_replacement_that_was_killed_is_undone(case: Path) -> None:
    recipe, aside = load_case(case).recipe, case.with_name(".a.replaced")
    case.rename(aside)
    with pytest.raises(ConfigError, match="cut short, and this is the case as it was: rename it"):
        find_cases(case.parent)
    recipe = replace(recipe, logs=(case / "log.mcap",))
    made = add_case(case, recipe, CountingRunner(), reason="again")
    assert [entry["reason"] for entry in made.history] == ["the first of this name", "again"]
    assert list(case.parent.iterdir()) == [case]


def test_what_is_weakened_is_in_the_history(case: Path) -> None:
    values = json.loads((case / CASE_FILE).read_text())
    values["tolerances"]["errors_cm"] = 1e-3
    (case / CASE_FILE).write_text(json.dumps(values))
    recipe = replace(load_case(case).recipe, schedule=Schedule(epochs=1), learner={"reservoir": 3})
    made = add_case(case, recipe, CountingRunner(), reason=" quicker ")
    assert made.tolerances == Tolerances(errors_cm=1e-3)
    epochs, neurons = made.history[1]["changed"]
    assert epochs.startswith('schedule: {"epochs": 2')
    assert neurons == "learner reservoir: None -> 3"
    assert made.history[1]["reason"] == "quicker"


def test_a_users_own_files_are_not_thrown_away(case: Path) -> None:
    (case / "notes.txt").write_text("mine")
    with pytest.raises(ConfigError, match=r"expected the files of the case alone, found 'notes\.txt'"):
        add_case(case, load_case(case).recipe, CountingRunner(), reason="x")
    assert (case / "notes.txt").read_text() == "mine"


def test_a_case_called_old_can_be_updated(case: Path) -> None:
    old = case.rename(case.with_name("old"))
    assert len(add_case(old, load_case(old).recipe, CountingRunner(), reason="x").history) == 2


@pytest.mark.parametrize("names", [("steps.bin",), ("case.json",), ("states.npz",), ("log.mcap", "log.mcap.index")])
def test_logs_called_as_a_cases_own_files(tmp_path: Path, names: tuple[str, ...]) -> None:
    logs = tuple(write_plain_episode(tmp_path / name, samples=4) for name in names)
    with pytest.raises(ConfigError, match="different names, none of them"):
        add_case(tmp_path / "cases" / "a", CaseSpec(logs, {}, Schedule(epochs=1)), CountingRunner())
    assert not list((tmp_path / "cases").iterdir())


def test_a_log_that_is_too_large_is_not_learned_from(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    log = write_plain_episode(tmp_path / "log.mcap", samples=4)
    monkeypatch.setattr("replay.golden.add.MAX_CASE_BYTES", 1000)
    with pytest.raises(ConfigError, match="expected at most 1000 bytes"):
        add_case(tmp_path / "a", CaseSpec((log,), {}, Schedule(epochs=1)), CrashingRunner("learn"))


def test_a_case_that_does_not_hold_is_not_kept(tmp_path: Path) -> None:
    log = write_plain_episode(tmp_path / "log.mcap", samples=4)
    runner = CountingRunner()
    runner.pack = lambda states: json.dumps([[0.0]]).encode()  # type: ignore[method-assign]
    with pytest.raises(ConfigError, match="does not hold as soon as it is written: learning: epoch 0: count"):
        add_case(tmp_path / "cases" / "a", CaseSpec((log,), {}, Schedule(epochs=1)), runner)
    assert not list((tmp_path / "cases").iterdir())


def test_progress_of_adding(tmp_path: Path) -> None:
    log = write_plain_episode(tmp_path / "log.mcap", samples=4)
    told: list[float] = []
    add_case(tmp_path / "a", CaseSpec((log,), {}, Schedule(epochs=2)), CountingRunner(), progress=told.append)
    assert told == sorted(told)
    assert len(told) == 4
    assert told[-1] == 1.0


def test_no_cases(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="expected golden cases"):
        find_cases(tmp_path)


def test_two_logs_of_one_name(tmp_path: Path) -> None:
    log = write_plain_episode(tmp_path / "log.mcap", samples=4)
    with pytest.raises(ConfigError, match="different names"):
        add_case(tmp_path / "a", CaseSpec((log, log), {}, Schedule(epochs=1)), CountingRunner())


def test_physics_is_compared_within_its_tolerance(tmp_path: Path) -> None:
    log = write_plain_episode(tmp_path / "log.mcap", samples=4)

    def made(shift: float) -> Iterator[tuple[str, Message]]:
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


class SimulatingRunner(CountingRunner):
    """Counts, and simulates what the log has, its joints off by a little."""

    def __init__(self, *, shift: float, resolution: bool) -> None:
        super().__init__()
        self._shift, self._resolution = shift, resolution

    def simulate(self, log: Path, *, ticks: int) -> Iterator[tuple[str, Message]]:
        for record in LogReader(log):
            message = decode(record.type, record.data)
            if isinstance(message, JointState):
                message = replace(message, position=message.position + self._shift)
            yield record.topic, message

    def physics_tolerance(self, log: Path) -> float | None:
        return 0.0 if self._resolution else None


def test_physics_of_a_robot_with_a_resolution_is_exact(tmp_path: Path) -> None:
    log = write_plain_episode(tmp_path / "log.mcap", samples=4)
    spec, exact = CaseSpec((log,), {}, Schedule(epochs=2), physics=True), SimulatingRunner(shift=0.0, resolution=True)
    folder = add_case(tmp_path / "cases" / "a", spec, exact).folder
    assert check_case(folder, exact).finding is None
    assert check_case(folder, SimulatingRunner(shift=1e-10, resolution=False)).finding is None  # within the tolerance
    finding = check_case(folder, SimulatingRunner(shift=1e-10, resolution=True)).finding
    assert finding is not None
    assert (finding.tier, finding.field) == ("physics", "position[0] (hip_height)")
    assert finding.note == "tolerance 0"


def test_a_simulation_that_stops_early_does_not_hold(tmp_path: Path) -> None:
    log = write_plain_episode(tmp_path / "log.mcap", samples=4)
    messages = [(record.topic, decode(record.type, record.data)) for record in LogReader(log)]
    assert first_beyond(log, messages, Tolerances()) is None
    assert first_beyond(log, messages[:9], Tolerances(), ticks=3) is None
    for kept in range(len(messages)):
        finding = first_beyond(log, messages[:kept], Tolerances())
        assert finding is not None
        assert (finding.tier, finding.field, finding.expected, finding.found) == (
            "physics",
            "message",
            "present",
            "absent",
        )
        assert (finding.place["topic"], finding.place["sequence"]) == (messages[kept][0], kept // 3)


def test_joints_that_lack_their_positions_do_not_hold(tmp_path: Path) -> None:
    log = write_plain_episode(tmp_path / "log.mcap", samples=4)
    made = [(record.topic, decode(record.type, record.data)) for record in LogReader(log)]
    made = [
        (topic, replace(message, position=[]) if isinstance(message, JointState) else message)
        for topic, message in made
    ]
    finding = first_beyond(log, made, Tolerances())
    assert finding is not None
    assert (finding.field, finding.expected, finding.found) == ("len(position)", "15", "0")
