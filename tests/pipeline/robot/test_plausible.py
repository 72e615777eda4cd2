"""What cannot be the robot's is refused on every way in, by name, with the unit that it seems to be in."""

import math
import re
import shlex
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from episodes import write_episode

from pipeline.cli import app
from pipeline.learner.rules.reservoir.config import LearnerConfig
from pipeline.motions.patterns.circles import circles
from pipeline.robot.config import load_robot, robot_names
from pipeline.robot.range_check import range_check
from pipeline.serving.config import ServingConfig
from pipeline.serving.served_controller import ServedController
from pipeline.training.trainer import train
from recorders.cdr.codec import encode
from recorders.errors import JointError, OutOfRange
from recorders.messages.message_types import JointState, Message, PoseStamped
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import LEFT_TARGET, SAMPLE_JOINTS
from replay.sources.schedule import Schedule

ASIMO = load_robot("asimo")
HIP_HEIGHT = ASIMO.joints.index("hip_height")


def scaled(factor: float) -> Callable[[int, str, Message], Sequence[tuple[str, Message]]]:
    """Targets in another unit than metres."""

    def change(tick: int, topic: str, message: Message) -> Sequence[tuple[str, Message]]:
        return [(topic, replace(message, position=message.position * factor) if topic != SAMPLE_JOINTS else message)]

    return change


def joints_changed(
    positions: Callable[[np.ndarray], object], name: Sequence[str] = ASIMO.joints, *, since: int = 0
) -> Callable[[int, str, Message], Sequence[tuple[str, Message]]]:
    def change(tick: int, topic: str, message: Message) -> Sequence[tuple[str, Message]]:
        if isinstance(message, JointState) and tick >= since:
            changed = np.asarray(positions(np.array(message.position)), dtype=np.float64)
            message = JointState(message.stamp_ns, tuple(name), changed)
        return [(topic, message)]

    return change


def hip_in(scale: float) -> Callable[[np.ndarray], np.ndarray]:
    return lambda q: q * np.where(np.arange(len(q)) == HIP_HEIGHT, scale, 1.0)


LOGS = {
    "millimetres": (scaled(1e3), "/hand/left/target #0: .*: looks like millimetres$"),
    "centimetres": (scaled(1e2), "/hand/left/target #0: .*: looks like centimetres$"),
    "inches": (scaled(1.0 / 0.0254), "/hand/left/target #0: .*: looks like inches$"),
    "far": (scaled(1e7), r"/hand/left/target #0: expected a target within 4\.6 m of the patterns, found .* m$"),
    "degrees": (joints_changed(np.rad2deg), r"/sample/joint_states #0: expected \w+ near its .*: looks like degrees$"),
    "out_of_order": (
        joints_changed(lambda q: q, [*ASIMO.joints[5:], *ASIMO.joints[:5]]),
        r"/sample/joint_states #0: expected \w+ near its limits \S+ and \S+, found \S+[^s]$",
    ),
    "hip_in_mm": (joints_changed(hip_in(1e3)), r"expected hip_height near its .*: looks like millimetres$"),
    "no_number": (
        joints_changed(lambda q: np.where(np.arange(len(q)) == 4, np.nan, q), since=3),
        r"/sample/joint_states #3: expected left_shoulder_pitch near its limits -2\.6 and 1, found nan$",
    ),
}
VERBS = [
    "train {} --epochs 1 --out new.npz",
    "evaluate controller.npz {}",
    "evaluate controller.npz circles --linear-from {}",
    "golden add {} --config learner.toml --cases golden --name new",
]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("range_check")
    for name, (change, _) in LOGS.items():
        write_episode(folder / f"{name}.mcap", samples=5, change=change)
    log = write_episode(folder / "sound.mcap", samples=5)
    config = LearnerConfig(reservoir=20)
    train([log], schedule=Schedule(epochs=1), config=config).controller().save(folder / "controller.npz")
    (folder / "learner.toml").write_text("reservoir = 20\n")
    targets = circles(ASIMO).targets[:20].reshape(20, 6)
    for name, factor in (("millimetres", 1e3), ("centimetres", 1e2)):
        rows = [",".join(f"{value:.6f}" for value in [0.2 * k, *row]) for k, row in enumerate(targets * factor)]
        (folder / f"{name}.csv").write_text("\n".join(["t,lx,ly,lz,rx,ry,rz", *rows]) + "\n")
    return folder


def refused(line: str, folder: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> str:
    monkeypatch.chdir(folder)
    with pytest.raises(SystemExit) as end:
        app.main(shlex.split(line))
    printed = capfd.readouterr()
    assert (end.value.code, printed.out) == (2, "")
    (complaint,) = printed.err.splitlines()
    assert not any((folder / name).exists() for name in ("new.npz", "new.mcap", "golden/new"))
    return complaint


@pytest.mark.parametrize("verb", VERBS, ids=lambda verb: " ".join(verb.split()[:2]))
@pytest.mark.parametrize("name", LOGS)
def test_a_log_of_other_numbers_is_refused_by_every_verb(
    folder: Path, name: str, verb: str, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    complaint = refused(verb.format(f"{name}.mcap"), folder, monkeypatch, capfd)
    assert f"{name}.mcap: " in complaint
    _, _, pattern = complaint.partition(f"{name}.mcap: ")
    assert re.search(LOGS[name][1], pattern), complaint


@pytest.mark.parametrize(
    "verb", ["evaluate controller.npz", "explore --out new.mcap --motion", "demonstrate --out new.mcap"]
)
@pytest.mark.parametrize("unit", ["millimetres", "centimetres"])
def test_a_motion_in_another_unit_is_refused_by_every_verb(
    folder: Path, unit: str, verb: str, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    assert f"looks like {unit}" in refused(f"{verb} {unit}.csv", folder, monkeypatch, capfd)


def test_no_choice_of_what_is_out_of_reach_lets_another_unit_pass(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    for options in ("--on-unreachable clip", "--on-unreachable keep --align as-is"):
        line = f"demonstrate centimetres.csv {options} --out new.mcap"
        assert "looks like centimetres; bring it to metres with --scale" in refused(line, folder, monkeypatch, capfd)


def test_served_targets_and_joints_are_checked_by_the_same_rule(folder: Path, caplog: pytest.LogCaptureFixture) -> None:
    from pipeline.learner.controller import Controller

    served = ServedController(Controller.load(folder / "controller.npz"), config=ServingConfig(learn=True))
    wrong: list[tuple[str, Message]] = [
        (LEFT_TARGET, PoseStamped(1, ASIMO.centres[0] * 1e3)),
        (SAMPLE_JOINTS, JointState(1, ASIMO.joints, np.rad2deg(ASIMO.comfort))),
    ]
    for topic, message in wrong:
        assert served.take(RecordedMessage(topic, message.TYPE, encode(message), 0, 0)) is None
    assert served.status()["refused"] == {"out of range": 2}
    assert caplog.messages[0].endswith("looks like millimetres")
    assert served.status()["last_refusal"].endswith("looks like degrees")


def test_joints_that_the_robot_does_not_have_are_nobodys_business(folder: Path, tmp_path: Path) -> None:
    names = ("gripper", *ASIMO.joints, "other_gripper")
    log = write_episode(
        tmp_path / "grippers.mcap", samples=5, change=joints_changed(lambda q: [np.nan, *q, np.inf], names)
    )
    config, schedule = LearnerConfig(reservoir=20), Schedule(epochs=1)
    digests = [
        train([path], schedule=schedule, config=config).result()["digest"] for path in (log, folder / "sound.mcap")
    ]
    assert digests[0] == digests[1]


@pytest.mark.parametrize("name", ["asimo", "small"])
def test_whatever_the_joints_allow_passes(name: str, tmp_path: Path) -> None:
    from small_robot import write_robot

    robot = load_robot(name if name in robot_names() else write_robot(tmp_path / name))
    check = range_check(robot)
    for posture in (robot.lower, robot.upper, robot.comfort, 2.0 * robot.upper - robot.lower):
        check(JointState(0, robot.joints, posture))
    for hand in (robot.centres[0], robot.centres[1]):
        check(hand)
        check(hand + 1.0)
    for posture in (3.0 * robot.upper - 2.0 * robot.lower, robot.comfort * math.nan, robot.comfort + math.inf):
        with pytest.raises(OutOfRange, match=f"expected {robot.joints[0]} near its limits"):
            check(JointState(0, robot.joints, posture))
    with pytest.raises(JointError, match=f"no joint {robot.joints[0]}"):
        check(JointState(0, robot.joints[1:], robot.comfort[1:]))
