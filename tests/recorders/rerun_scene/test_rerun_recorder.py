"""A Rerun recording holds what it was given, moves the robot by its joints, and sends nothing to anyone."""

import json
import os
import subprocess
import sys
import textwrap
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rerun.chunk import RrdReader

from recorders.errors import JointError, LogError, MotionError, ReenactError, RobotError
from recorders.rerun_scene.recording import APPLICATION_ID, record_motion
from recorders.rerun_scene.viewer import viewer_environment

# A column that is lifted by `lift` and turned by `turn`; the hand is 0.5 m out, 1 m up.
CRANE = """
<robot name="crane">
  <link name="world"/>
  <joint name="lift" type="prismatic">
    <origin xyz="0 0 1"/><parent link="world"/><child link="column"/><axis xyz="0 0 1"/>
    <limit lower="-0.1" upper="0.1" effort="1" velocity="1"/>
  </joint>
  <link name="column"/>
  <joint name="turn" type="revolute">
    <parent link="column"/><child link="arm"/><axis xyz="0 0 1"/>
    <limit lower="-0.5" upper="0.5" effort="1" velocity="1"/>
  </joint>
  <link name="arm"><visual><geometry><box size="0.5 0.1 0.1"/></geometry></visual></link>
  <joint name="wrist" type="fixed"><origin xyz="0.5 0 0"/><parent link="arm"/><child link="hand"/></joint>
  <link name="hand"/>
</robot>
"""
STEPS = 40


def motion() -> dict[str, Any]:
    time_s = np.arange(STEPS) * 0.1
    turn, lift = np.sin(time_s), 0.05 * np.cos(time_s)  # the turn leaves its limits: what was recorded is shown
    reached = np.stack([0.5 * np.cos(turn), 0.5 * np.sin(turn), 1.0 + lift], axis=1)  # (T, 3)
    hands = np.stack([reached, reached * [1.0, -1.0, 1.0]], axis=1)  # (T, 2, 3)
    return {
        "urdf_text": CRANE,
        "joint_names": ("turn", "lift"),  # not the order of the URDF
        "times_ns": np.arange(STEPS) * 100_000_000,
        "joints": np.column_stack([turn, lift]),
        "targets": hands + np.array([0.03, 0.0, 0.04]),
        "reached": hands,
        "title": "a crane",
    }


def rows(path: Path, entity: str, component: str, *, static: bool = False) -> list[Any]:
    chunks = [c for c in RrdReader(path).stream() if c.entity_path == entity and c.is_static == static]
    batches = [c.to_record_batch() for c in chunks]
    return [row for batch in batches if component in batch.schema.names for row in batch.column(component).to_pylist()]


def hand_position(path: Path, step: int) -> np.ndarray:
    """Where the links' frames, as recorded, put the hand at a step."""
    transforms = {}
    for entity in ("/robot/links", "/robot/moving"):
        static = entity == "/robot/links"
        names = ("child_frame", "parent_frame", "translation", "quaternion")
        columns = [rows(path, entity, f"Transform3D:{name}", static=static) for name in names]
        table = list(zip(*columns, strict=True))
        for child, parent, translation, quaternion in table if static else table[2 * step : 2 * step + 2]:
            transforms[child[0]] = (parent[0], np.array(translation[0]), np.array(quaternion[0]))
    point, frame = np.zeros(3), "hand"
    while frame != "world":
        frame, translation, quaternion = transforms[frame]
        axis, w = quaternion[:3], quaternion[3]
        turned = np.cross(axis, point)
        point = translation + point + 2.0 * (w * turned + np.cross(axis, turned))
    return point


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("rerun") / "crane.rrd"
    record_motion(path, **motion())
    return path


def test_the_file_is_one_recording_of_ours_with_a_layout(recording: Path) -> None:
    reader = RrdReader(recording)
    assert [store.application_id for store in reader.recordings()] == [APPLICATION_ID]
    assert [store.application_id for store in reader.blueprints()] == [APPLICATION_ID]
    assert rows(recording, "/__properties", "RecordingInfo:name", static=True) == [["a crane"]]


def test_rerun_itself_finds_no_fault_in_the_file(recording: Path, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "rerun_cli", "rrd", "verify", str(recording)]
    result = subprocess.run(command, env=viewer_environment(tmp_path), capture_output=True, text=True, timeout=60)
    assert result.returncode == 0, result.stderr


def test_joints_are_stored_as_given_under_their_names_and_units(recording: Path) -> None:
    np.testing.assert_array_equal(rows(recording, "/joints", "Scalars:scalars"), motion()["joints"])
    assert rows(recording, "/joints", "SeriesLines:names", static=True) == [["turn [rad]", "lift [m]"]]


@pytest.mark.parametrize(("hand", "side"), [(0, "left"), (1, "right")])
def test_hands_targets_and_errors_are_those_of_the_motion(recording: Path, hand: int, side: str) -> None:
    given = motion()
    for name in ("target", "reached"):
        positions = rows(recording, f"/hands/{side}/{name}", "Points3D:positions")
        expected = given["targets" if name == "target" else name][:, hand]
        np.testing.assert_allclose(np.array(positions)[:, 0], expected, atol=1e-7)
    errors_cm = rows(recording, f"/error/{side}", "Scalars:scalars")
    np.testing.assert_allclose(np.array(errors_cm)[:, 0], 5.0, rtol=1e-12)  # 3 cm ahead, 4 cm up


def test_times_are_exact_to_the_nanosecond(recording: Path) -> None:
    chunks = [c for c in RrdReader(recording).stream() if c.entity_path == "/joints" and not c.is_static]
    times = np.concatenate([c.to_record_batch().column("time").to_numpy() for c in chunks])
    np.testing.assert_array_equal(times.astype("int64"), np.arange(STEPS) * 100_000_000)


def test_nothing_is_stamped_with_the_clock_of_the_machine(recording: Path) -> None:
    assert {name for chunk in RrdReader(recording).stream() for name in chunk.timeline_names} == {"time"}


@pytest.mark.parametrize("step", [0, 13, STEPS - 1])
def test_the_links_move_as_the_joints_say(recording: Path, step: int) -> None:
    np.testing.assert_allclose(hand_position(recording, step), motion()["reached"][step, 0], atol=1e-6)


def test_equal_input_has_one_recording_id_and_other_input_another(tmp_path: Path) -> None:
    def recording_id(**changes: Any) -> str:
        record_motion(tmp_path / "x.rrd", **(motion() | changes))
        return str(RrdReader(tmp_path / "x.rrd").recordings()[0].recording_id)

    other = motion()["joints"].copy()
    other[3, 1] += 1e-12
    assert len({recording_id(), recording_id(), recording_id(joints=other), recording_id(title="b")}) == 3


def changed(name: str, change: Callable[[np.ndarray], np.ndarray]) -> dict[str, Any]:
    return {name: change(np.array(motion()[name]))}


def with_nan(array: np.ndarray) -> np.ndarray:
    array[-1] = np.nan
    return array


@pytest.mark.parametrize(
    ("changes", "error", "message"),
    [
        ({"urdf_text": "<robot"}, RobotError, "the URDF cannot be read"),
        ({"joint_names": ("turn", "tilt")}, JointError, "found 'tilt'; it has lift, turn"),
        ({"joint_names": ("turn", "wrist")}, JointError, "found 'wrist'; it has lift, turn"),
        ({"joint_names": ("turn", "turn")}, JointError, "each joint once, found turn, turn"),
        ({"joint_names": ("turn",)}, JointError, r"shape \(40, 1\), found \(40, 2\)"),
        (changed("joints", lambda a: a[:-1]), JointError, r"shape \(40, 2\), found \(39, 2\)"),
        (changed("times_ns", lambda a: a[:0]), MotionError, r"T >= 1, found \(0,\)"),
        (changed("times_ns", lambda a: a[:, None]), MotionError, r"\(T,\) with T >= 1, found \(40, 1\)"),
        (changed("times_ns", lambda a: a / 1e9), MotionError, "whole nanoseconds"),
        (
            changed("times_ns", lambda a: np.array([*a[1:], 2**63])),
            MotionError,
            "whole nanoseconds, 9223372036854775807 at most",
        ),
        (changed("times_ns", lambda a: np.array([*a[1:], -(2**63)])), MotionError, "whole nanoseconds"),
        (changed("targets", lambda a: a.reshape(-1, 6)), MotionError, r"targets of shape \(40, 2, 3\), found"),
        (changed("reached", lambda a: a[:, :1]), MotionError, r"reached of shape \(40, 2, 3\), found \(40, 1, 3\)"),
        (changed("joints", with_nan), MotionError, "finite numbers within 1e\\+09 of zero in joints"),
        (changed("targets", lambda a: a + 1e300), MotionError, "finite numbers within 1e\\+09 of zero in targets"),
        (changed("reached", with_nan), MotionError, "finite numbers within 1e\\+09 of zero in reached"),
    ],
)
def test_unusable_input_is_one_line_and_leaves_no_file(
    tmp_path: Path, changes: dict[str, Any], error: type[ReenactError], message: str
) -> None:
    with pytest.raises(error, match=message) as raised:
        record_motion(tmp_path / "x.rrd", **(motion() | changes))
    assert "\n" not in str(raised.value)
    assert not (tmp_path / "x.rrd").exists()


@pytest.mark.parametrize("path", ["missing/x.rrd", "/dev/full"])
def test_a_file_that_cannot_be_written_is_one_line(tmp_path: Path, path: str) -> None:
    with pytest.raises(LogError, match="cannot write the recording") as raised:
        record_motion(tmp_path / path, **motion())
    assert "\n" not in str(raised.value)


def test_a_single_sample_on_the_axis_of_the_robot_is_drawn_too(tmp_path: Path) -> None:
    still = {name: motion()[name][:1] for name in ("times_ns", "joints")}
    hands = np.full((1, 2, 3), [0.0, 0.0, 1.0])
    record_motion(tmp_path / "x.rrd", **(motion() | still | {"targets": hands, "reached": hands}))
    assert rows(tmp_path / "x.rrd", "/error/left", "Scalars:scalars") == [[0.0]]


def private_home(home: Path) -> dict[str, str]:
    """An environment with an empty home and none of the switches, as a user's first run would have it."""
    kept = {name: value for name, value in os.environ.items() if not name.startswith(("XDG_", "RERUN", "CI", "FORCE_"))}
    return kept | {"HOME": str(home), "PYTHONDONTWRITEBYTECODE": "1"}


def test_recording_opens_no_connection_and_leaves_nothing_in_the_home(tmp_path: Path) -> None:
    (tmp_path / "home").mkdir()
    (tmp_path / "motion.json").write_text(json.dumps(motion(), default=np.ndarray.tolist))
    script = """
        import json, os
        from pathlib import Path
        from recorders.rerun_scene.recording import record_motion
        record_motion(Path("out.rrd"), **json.loads(Path("motion.json").read_text()))
        tables = [Path("/proc/self/net", name).read_text().splitlines()[1:] for name in ("tcp", "tcp6", "udp", "udp6")]
        internet = {f"socket:[{line.split()[9]}]" for table in tables for line in table}
        files = [f"/proc/self/fd/{name}" for name in os.listdir("/proc/self/fd")]
        print(json.dumps(sorted(internet & {os.readlink(file) for file in files if os.path.islink(file)})))
    """
    environment = private_home(tmp_path / "home") | {"PYTHONPATH": os.pathsep.join(sys.path)}
    result = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(script)],
        env=environment, cwd=tmp_path, capture_output=True, text=True, timeout=60,
    )  # fmt: skip
    assert result.returncode == 0, result.stderr
    assert json.loads(result.stdout) == []
    assert "usage data" not in result.stderr  # what Rerun says when its analytics first start
    assert list((tmp_path / "home").iterdir()) == []
    assert sorted(file.name for file in tmp_path.iterdir()) == ["home", "motion.json", "out.rrd"]


def test_the_viewer_environment_switches_the_analytics_of_rerun_off(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    home, config_home = tmp_path / "home", tmp_path / "config"
    home.mkdir()
    config_home.mkdir()
    monkeypatch.setenv("HOME", str(home))
    monkeypatch.setenv("FORCE_RERUN_ANALYTICS", "1")
    environment = viewer_environment(config_home)
    assert "FORCE_RERUN_ANALYTICS" not in environment
    assert environment["CI"]
    command = [sys.executable, "-m", "rerun_cli", "analytics", "config"]
    result = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=60)
    assert json.loads(result.stdout)["analytics_enabled"] is False
    assert "usage data" not in result.stderr
    assert list(home.iterdir()) == []
    assert [file.name for file in (config_home / "rerun").iterdir()] == ["analytics.json"]


def test_a_recording_takes_the_place_of_a_link_and_leaves_what_it_points_to(tmp_path: Path) -> None:
    (tmp_path / "empty").touch()
    (tmp_path / "x.rrd").symlink_to(tmp_path / "empty")
    record_motion(tmp_path / "x.rrd", **motion())
    assert not (tmp_path / "x.rrd").is_symlink()
    assert (tmp_path / "empty").read_bytes() == b""
