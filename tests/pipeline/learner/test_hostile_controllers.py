"""Controllers and golden cases may come from anyone: what they claim is bounded before it is unpacked or run."""

import hashlib
import io
import json
import shutil
import struct
import subprocess
import sys
import zipfile
import zlib
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from episodes import write_episode

from pipeline.golden.runner import GoldenRunner
from pipeline.learner import npz
from pipeline.learner.controller import Controller
from pipeline.learner.rules.reservoir.config import MAX_FILE_NEURONS as MAX_NEURONS
from pipeline.learner.rules.reservoir.config import LearnerConfig
from pipeline.learner.state import MAX_NUMBERS
from pipeline.robot.config import load_robot
from pipeline.serving.served_controller import ServedController
from pipeline.training.trainer import train
from recorders.errors import ConfigError, ControllerError
from replay.golden.add import add_case
from replay.golden.recipe import CaseSpec
from replay.sources.schedule import Schedule

SUPPORT = Path(__file__).parents[2] / "support"
MOST_MB = 300
LOCAL, CENTRAL, END = struct.Struct("<4s5H3L2H"), struct.Struct("<4s6H3L5H2L"), struct.Struct("<4s4H2LH")


def zipped(members: dict[str, tuple[int, int, bytes]], *, places: int = 1, end_count: int | None = None) -> bytes:
    """A zip written by hand: members by name, each with packing, claimed size and bytes; each listed `places` times."""
    body, directory = io.BytesIO(), io.BytesIO()
    for name, (packing, size, data) in members.items():
        place, raw = body.tell(), f"{name}.npy".encode()
        common = (
            0,
            packing,
            0,
            0x21,
            zlib.crc32(data),
            len(data),
            size,
        )  # of what is stored: nobody gets further with more
        body.write(LOCAL.pack(b"PK\x03\x04", 20, *common, len(raw), 0) + raw + data)
        entry = CENTRAL.pack(b"PK\x01\x02", 20, 20, *common, len(raw), 0, 0, 0, 0, 0, place) + raw
        directory.write(entry * places)
    count = min(len(members) * places, 0xFFFF) if end_count is None else end_count
    end = END.pack(b"PK\x05\x06", 0, 0, count, count, directory.tell(), body.tell(), 0)
    return body.getvalue() + directory.getvalue() + end


@cache
def bomb(size: int) -> bytes:
    """A deflate stream of so many zeros."""
    packer = zlib.compressobj(1, zlib.DEFLATED, -15)
    return b"".join([packer.compress(bytes(2**20)) for _ in range(size >> 20)]) + packer.flush()


def header(path: Path, **config: object) -> bytes:
    """The header of a controller, with other settings."""
    text = npz.unpack(path.read_bytes())["header"]
    assert isinstance(text, str)
    values = json.loads(text)
    values["config"] |= config
    member = io.BytesIO()
    np.lib.format.write_array(member, np.frombuffer(json.dumps(values).encode(), dtype="|u1"), version=(1, 0))
    return member.getvalue()


def with_header(path: Path, **config: object) -> bytes:
    text = header(path, **config)
    return zipped({"header": (0, len(text), text)})


HOSTILE: dict[str, Callable[[Path], bytes]] = {
    "more_than_it_claims": lambda path: zipped({"header": (8, 1000, bomb(384 << 20))}),
    "as_much_as_it_claims": lambda path: zipped({"header": (8, 384 << 20, bomb(384 << 20))}),
    "a_header_without_end": lambda path: zipped({"header": (8, 11 << 20, bomb(11 << 20))}),
    "one_member_many_times": lambda path: zipped({"header": (0, 8, bytes(8))}, places=200_000),
    "a_directory_that_says_less": lambda path: zipped({"header": (0, 8, bytes(8))}, places=60_000, end_count=1),
    "many_neurons": lambda path: with_header(path, reservoir=900_000, reservoir_reservoir_density=0.0),
    "many_connections": lambda path: with_header(path, reservoir=4400, reservoir_reservoir_density=1.0),
    "many_inputs": lambda path: with_header(path, inputs=900_000, input_reservoir_density=0.0),
}


JOINTS = load_robot("asimo").joints
FOREIGN = {
    "permuted": (*JOINTS[1:], JOINTS[0]),
    "nonsense": tuple(f"joint_{place}" for place in range(len(JOINTS))),
}
Change = Callable[[dict[str, Any]], None]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a sound controller, hostile ones, and golden cases with hostile parts."""
    folder = tmp_path_factory.mktemp("hostile")
    log = write_episode(folder / "log.mcap", samples=4)
    trainer = train([log], schedule=Schedule(epochs=1), config=LearnerConfig(reservoir=20))
    trainer.controller().save(folder / "sound.npz")
    for name, made in HOSTILE.items():
        (folder / f"{name}.npz").write_bytes(made(folder / "sound.npz"))
    sound = Controller.load(folder / "sound.npz")
    for name, joints in FOREIGN.items():
        replace(sound, joints=joints).save(folder / f"{name}.npz")
    return folder


@pytest.fixture(scope="module")
def cases(folder: Path) -> Path:
    recipe = CaseSpec((folder / "log.mcap",), LearnerConfig(reservoir=20).to_dict(), Schedule(epochs=1))
    golden, source = folder / "golden", add_case(folder / "golden/sound", recipe, GoldenRunner()).folder
    changes: dict[str, Change] = {
        "reservoir": lambda case: case["learner"].update(reservoir=900_000, reservoir_reservoir_density=0.0),
        "dense": lambda case: case["learner"].update(reservoir=4000, reservoir_reservoir_density=1.0),
        "cycles": lambda case: case["schedule"].update(phases=[["learn", 1_000_000]]),
    }
    for name, change in changes.items():
        copy_case(source, golden / name, change)
    for name, made in HOSTILE.items():
        copy_case(source, golden / name, states=made(folder / "sound.npz"))
    return golden


def copy_case(source: Path, target: Path, change: Change = lambda case: None, *, states: bytes = b"") -> None:
    """Copy a case, with other settings or states; its hashes are those of what it holds, as a forger makes them."""
    shutil.copytree(source, target)
    case = json.loads((target / "case.json").read_text())
    change(case)
    if states:
        (target / "states.npz").write_bytes(states)
        case["files"]["states.npz"] = hashlib.sha256(states).hexdigest()
    (target / "case.json").write_text(json.dumps(case))


@pytest.fixture(scope="module")
def results(folder: Path, cases: Path) -> dict[str, tuple[int, str, float]]:
    """Status, what was printed, and the peak memory so far [MB] by command line, of one process for all."""
    names = ("sound", *HOSTILE, *FOREIGN)
    lines = [f"evaluate {name}.npz circles" for name in names] + [f"diff {name}.npz {name}.npz" for name in HOSTILE]
    lines += [f"golden check {cases.name}", *(f"view {name}.npz --save {name}.rrd" for name in FOREIGN)]
    command = [sys.executable, str(SUPPORT / "hostile_file.py"), json.dumps(lines)]
    run = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    return dict(zip(lines, json.loads(run.stdout), strict=True))


def test_what_claims_too_much_is_one_line(results: dict[str, tuple[int, str, float]]) -> None:
    assert results["evaluate sound.npz circles"][0] == 0
    for line, (status, said, _) in results.items():
        if line.split()[0] in ("evaluate", "diff") and line.split()[1].removesuffix(".npz") in HOSTILE:
            assert status == 2, (line, said)
            assert said.startswith("reenact: cannot use controller"), (line, said)
            assert len(said.splitlines()) == 1, (line, said)


def test_a_case_that_claims_too_much_fails_alone(results: dict[str, tuple[int, str, float]], cases: Path) -> None:
    status, said, _ = results["golden check golden"]
    verdicts = {line.split()[1]: line.split()[0] for line in said.splitlines()}
    assert status == 1
    assert verdicts == {path.name: "passed" if path.name == "sound" else "failed" for path in cases.iterdir()}


def test_none_of_it_takes_much_memory(results: dict[str, tuple[int, str, float]]) -> None:
    peaks = {line: peak for line, (_, _, peak) in results.items() if not line.startswith("view")}  # a viewer's own
    assert max(peaks.values()) < MOST_MB, peaks


@pytest.mark.parametrize("verb", ["evaluate {}.npz circles", "view {0}.npz --save {0}.rrd"])
@pytest.mark.parametrize("name", FOREIGN)
def test_a_controller_of_other_joints_than_its_robots_is_refused(
    results: dict[str, tuple[int, str, float]], folder: Path, name: str, verb: str
) -> None:
    status, said, _ = results[verb.format(name)]
    assert status == 2
    assert said.startswith("reenact: expected a controller of two hands and the joints of asimo, hip_height, "), said
    assert not (folder / f"{name}.rrd").exists()
    with pytest.raises(ControllerError, match="expected a controller of two hands and the joints of asimo"):
        ServedController(Controller.load(folder / f"{name}.npz"))


def test_members_may_neither_overlap_nor_have_one_name() -> None:
    text = npz.pack({"a": np.zeros(2)})
    member = zipfile.ZipFile(io.BytesIO(text)).read("a.npy")
    assert list(npz.unpack(zipped({"a": (0, len(member), member), "b": (0, len(member), member)}))) == ["a", "b"]
    for wrong, why in (
        (zipped({"a": (0, len(member), member)}, places=2), "different names"),
        (zipped({"a": (0, len(member), member)}).replace(b"a.npy", b"b.npy", 1) + b"junk", "not a zip file"),
        (overlapping(member), "overlap"),
    ):
        with pytest.raises(ControllerError, match=why):
            npz.unpack(wrong)


def overlapping(member: bytes) -> bytes:
    """Two members of different names that claim the same bytes."""
    whole = zipped({"a": (0, len(member), member)}, places=2)
    second = whole.rindex(b"a.npy")
    return whole[:second] + b"b.npy" + whole[second + 5 :]


def test_a_network_too_large_for_a_file_is_not_written(tmp_path: Path) -> None:
    LearnerConfig(reservoir=1000, reservoir_reservoir_density=1.0).check_size()
    for config in (
        LearnerConfig(reservoir=MAX_NEURONS, reservoir_reservoir_density=0.0),
        LearnerConfig(reservoir=1100, reservoir_reservoir_density=1.0),
    ):
        with pytest.raises(ConfigError, match=f"expected at most {MAX_NEURONS} neurons and {MAX_NUMBERS} weights"):
            config.check_size()
