"""The first difference of two controllers is named with its place and both values; so is that of two files."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from episodes import write_episode

from pipeline.cli.logs.diff_files import diff
from pipeline.learner.controller import Controller
from pipeline.learner.controller_diff import ControllerDifference, first_difference, first_difference_of_arrays
from pipeline.learner.rules.reservoir.config import LearnerConfig
from pipeline.learner.rules.reservoir.learner import Learner
from recorders.errors import ReenactError
from recorders.messages.message_types import JointState
from replay.diff.divergence import Divergence

CONFIG = LearnerConfig(reservoir=30, outputs=8, epochs=2)
JOINTS = ("hip_yaw", "elbow")


@pytest.fixture(scope="module")
def controller() -> Controller:
    learner = Learner(CONFIG, input_centre=np.arange(6.0), output_centre=np.arange(8.0))
    return Controller.from_learner(learner, joints=JOINTS, robot_toml="a\nb\n", robot_urdf="<robot/>")


def with_state(controller: Controller, name: str, values: dict[int, float]) -> Controller:
    array = np.array(controller.state[name])
    for place, value in values.items():
        array[place] = value
    return replace(controller, state={**controller.state, name: array})


def found(a: Controller, b: Controller) -> ControllerDifference:
    difference = first_difference(a, b)
    assert difference is not None
    return difference


def test_equal_controllers_and_where_they_came_from(controller: Controller) -> None:
    assert first_difference(controller, controller) is None
    assert first_difference(controller, replace(controller, provenance={"logs": ["other.mcap"]})) is None


def test_one_element_of_the_state(controller: Controller) -> None:
    name = "reservoir_output_weights"
    a, b = with_state(controller, name, {17: 0.1}), with_state(controller, name, {17: 0.1 + 2**-56, 20: 9.0})
    size = a.state[name].size
    assert str(found(a, b)) == (
        f"{name}[17]: 0.1 in A, {math.nextafter(0.1, 1)!r} in B; 2 of its {size} elements differ"
    )


def test_every_array_of_the_state_counts_in_its_order(controller: Controller) -> None:
    names = [name for name, values in controller.state.items() if values.size]
    b = controller
    for name in reversed(names):
        b = with_state(b, name, {0: 0.77})
        assert found(controller, b).name == f"{name}[0]"


def test_the_sign_of_zero_counts(controller: Controller) -> None:
    a, b = with_state(controller, "e", {1: 0.0}), with_state(controller, "e", {1: -0.0})
    assert a.digest != b.digest
    assert (found(a, b).name, found(a, b).a, found(a, b).b) == ("e[1]", "0.0", "-0.0")


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        ({"config": replace(CONFIG, ip_mu=0.3)}, "config.ip_mu: 0.1 in A, 0.3 in B"),
        ({"output_centre": np.array([0, 1, 2, 3, 4, 5, 6, 9.0])}, "output_centre[7]: 7.0 in A, 9.0 in B; 1 of its 8"),
        ({"joints": ("hip_yaw", "wrist")}, "joints[1]: 'elbow' in A, 'wrist' in B"),
        ({"robot_toml": "a\nc\n"}, "robot_toml line 2: 'b' in A, 'c' in B"),
        ({"robot_toml": "a\nb"}, "robot_toml line 3: '' in A, absent in B"),
        ({"robot_urdf": ""}, "robot_urdf line 1: '<robot/>' in A, '' in B"),
        ({"pending": np.arange(6.0)}, "pending: shape (0,) in A, shape (6,) in B"),
    ],
)
def test_everything_else(controller: Controller, changes: dict[str, object], line: str) -> None:
    b = replace(controller, **changes)
    assert str(found(controller, b)).startswith(line)


def test_arrays_by_name() -> None:
    a, b = {"m": np.zeros((2, 3))}, {"m": np.zeros((2, 3))}
    assert first_difference_of_arrays(a, b) is None
    b["m"][1, 2] = 1.0
    assert str(first_difference_of_arrays(a, b)) == "m[1, 2]: 0.0 in A, 1.0 in B; 1 of its 6 elements differ"
    assert str(first_difference_of_arrays(a, {})) == "m: present in A, absent in B"


def test_two_files(controller: Controller, tmp_path: Path) -> None:
    for name, content in (("a", controller), ("b", with_state(controller, "a", {3: 2.0}))):
        content.save(tmp_path / f"{name}.npz")
    difference = diff(tmp_path / "a.npz", tmp_path / "b.npz")
    assert isinstance(difference, ControllerDifference)
    assert difference.name == "a[3]"
    assert diff(tmp_path / "a.npz", tmp_path / "a.npz") is None


def test_two_logs(tmp_path: Path) -> None:
    def bent(tick: int, topic: str, message: object) -> list[tuple[str, object]]:
        if tick == 3 and isinstance(message, JointState):
            message = replace(message, position=np.zeros(len(message.name)))
        return [(topic, message)]

    a = write_episode(tmp_path / "a.mcap", samples=5)
    b = write_episode(tmp_path / "b.mcap", samples=5, change=bent)
    divergence = diff(a, b)
    assert isinstance(divergence, Divergence)
    assert (divergence.topic, divergence.sequence, divergence.b) == ("/sample/joint_states", 3, "0.0")
    assert diff(a, a) is None


def test_files_of_no_kind_or_of_two(controller: Controller, tmp_path: Path) -> None:
    log = write_episode(tmp_path / "a.mcap", samples=2)
    controller.save(tmp_path / "a.npz")
    for name in ("a.csv", "b.csv"):
        (tmp_path / name).write_text("t")
    for a, b in ((log, tmp_path / "a.npz"), (tmp_path / "a.csv", tmp_path / "b.csv")):
        with pytest.raises(ReenactError, match=rf"expected two logs .*found {a.name} and {b.name}$"):
            diff(a, b)
    for name in ("gone.mcap", "gone.npz"):
        with pytest.raises(ReenactError, match=name):
            diff(tmp_path / name, tmp_path / name)
    with pytest.raises(ReenactError, match="gone: no such file"):
        diff(log, tmp_path / "gone")
