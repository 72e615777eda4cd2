"""A motion as a Rerun recording: the robot moving, both hands against their targets, and the plots beside them.

Analytics: Rerun's viewer and command line send usage data unless told not to. The library that this module uses writes
a file without starting any of that, which a test watches; `viewer_environment` gives the switches to those who start
the viewer.
"""

import hashlib
import json
import os
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import ArrayLike, NDArray
from rerun.urdf import UrdfJoint, UrdfTree

from recorders.errors import JointError, LogError, MotionError, RobotError

Floats = NDArray[np.float64]

APPLICATION_ID = "reenact"
TIMELINE = "time"
HANDS = ("left", "right")

_WORLD = "tf#/"  # the name that Rerun gives to the frame of a view whose origin is "/"
_TARGET_COLOUR = (160, 160, 160)
_HAND_COLOURS = ((86, 180, 233), (230, 159, 0))  # sky blue, orange: Okabe and Ito, for all kinds of colour vision
_TARGET_RADIUS_M = 0.012
_TRAIL_RADIUS_M = 0.004
_PATH_RADIUS_M = 0.0015
_EYE_M = np.array([0.9, 0.6, 0.3])  # from the hands: ahead, to the side, up
_LEAST_RANGE_CM = 0.1
_CM_PER_M = 100.0
_NS_PER_S = 1e9
_FOREVER, _NOW = rrb.TimeRangeBoundary.infinite(), rrb.TimeRangeBoundary.cursor_relative()


@dataclass(frozen=True, eq=False)
class _Track:
    """What is drawn, checked: one row per sample.

    Attributes
    ----------
    times_s : shape (T,)
    joints : postures [rad or m], shape (T, n)
    targets, reached : hand positions [m], left then right, shape (T, 2, 3)
    """

    times_s: Floats
    joints: Floats
    targets: Floats
    reached: Floats

    @property
    def index(self) -> rr.TimeColumn:
        """The times as Rerun wants them, rounded here: given seconds, it cuts 0.3 s to 299 999 999 ns."""
        return rr.TimeColumn(TIMELINE, duration=np.rint(self.times_s * _NS_PER_S).astype("timedelta64[ns]"))

    @property
    def errors_cm(self) -> Floats:
        """Distance of each hand from its target [cm], shape (T, 2)."""
        return np.asarray(np.linalg.norm(self.reached - self.targets, axis=2) * _CM_PER_M)

    def recording_id(self, *parts: str) -> str:
        """Return an identity made of the content, for the viewer merges recordings of one identity."""
        digest = hashlib.sha256(json.dumps(parts).encode())
        for array in (self.times_s, self.joints, self.targets, self.reached):
            digest.update(np.ascontiguousarray(array, dtype="<f8").tobytes())
        return digest.hexdigest()[:32]


def record_motion(
    path: Path,
    *,
    urdf_text: str,
    joint_names: Sequence[str],
    times_s: ArrayLike,
    joints: ArrayLike,
    targets: ArrayLike,
    reached: ArrayLike,
    title: str,
) -> None:
    """Write the recording (`.rrd`) of a robot following a motion; open it with `rerun FILE`.

    The body moves by the joints alone: Rerun puts the links together from the URDF. The same input gives the same
    content under the same recording id, yet not the same bytes, for Rerun numbers its rows by the clock.

    Parameters
    ----------
    path : Path
        File to write; replaced if it exists.
    urdf_text : str
        The robot; its root link is taken for the world frame.
    joint_names : sequence of str
        Names of the columns of `joints`; joints of the robot that are not named stay at zero.
    times_s : array, shape (T,)
        Time of each sample [s].
    joints : array, shape (T, n)
        Postures [rad or m].
    targets, reached : array, shape (T, 2, 3)
        Where each hand should be and where it was [m], left then right, world frame.
    title : str
        Name of the recording in the viewer.

    Raises
    ------
    RobotError
        The URDF cannot be read.
    JointError
        A joint is not in the URDF, is named twice, or `joints` has another shape than the names and times ask for.
    MotionError
        Times or positions are of the wrong shape, or a number is not finite.
    LogError
        The file cannot be written.
    """
    track = _checked(len(joint_names), times_s, joints, targets, reached)
    tree = _load_urdf(urdf_text)
    moving = _find_joints(tree, joint_names)
    _open_for_writing(path)
    recording = rr.RecordingStream(
        APPLICATION_ID, recording_id=track.recording_id(urdf_text, *joint_names, title), send_properties=False
    )
    recording.set_log_time_enabled(False)  # the clock of the machine has no place in a result
    try:
        recording.save(path, default_blueprint=_blueprint(track))
        recording.send_recording_name(title)
        _send_robot(recording, tree, moving, track)
        _send_hands(recording, track)
        _send_joints(recording, moving, track)
        recording.flush()
        recording.disconnect()  # writes the footer and closes the file
    except RuntimeError as error:  # what Rerun raises when the disk is full
        raise LogError(f"cannot write the recording '{path}': {error}") from error


def viewer_environment(config_home: Path) -> dict[str, str]:
    """Return environment variables under which Rerun's viewer and command line neither send nor keep usage data.

    A released Rerun has two switches, and this sets both: `analytics_enabled` in `rerun/analytics.json` under the
    user's configuration directory, which it writes there, switched on, if it finds none; and the variable `CI`, set to
    anything. `FORCE_RERUN_ANALYTICS` beats both, so it goes. A configuration directory of our own leaves the user's
    alone.

    Parameters
    ----------
    config_home : Path
        Existing directory that lives as long as the viewer; receives `rerun/analytics.json`.

    Returns
    -------
    dict
        A copy of this process's environment with these changes.
    """
    home = config_home.resolve()  # a relative XDG_CONFIG_HOME counts for nothing
    directory = home / "rerun"
    directory.mkdir(exist_ok=True)
    config_file = directory / "analytics.json"
    config = {
        "analytics_enabled": False,
        "analytics_id": "",
        "config_file_path": str(config_file),
        "data_dir_path": str(directory / "analytics"),
    }
    config_file.write_text(json.dumps(config), encoding="utf-8")
    kept = {name: value for name, value in os.environ.items() if name != "FORCE_RERUN_ANALYTICS"}
    return kept | {"CI": "1", "XDG_CONFIG_HOME": str(home)}


def _checked(joint_count: int, times_s: ArrayLike, joints: ArrayLike, targets: ArrayLike, reached: ArrayLike) -> _Track:
    track = _Track(*(np.array(array, dtype=np.float64) for array in (times_s, joints, targets, reached)))
    samples = len(track.times_s) if track.times_s.ndim == 1 else 0
    if samples == 0:
        raise MotionError(f"expected times of shape (T,) with T >= 1, found {track.times_s.shape}")
    if track.joints.shape != (samples, joint_count):
        raise JointError(f"expected joints of shape {(samples, joint_count)}, found {track.joints.shape}")
    for name in ("targets", "reached"):
        if getattr(track, name).shape != (samples, 2, 3):
            raise MotionError(f"expected {name} of shape {(samples, 2, 3)}, found {getattr(track, name).shape}")
    for name in ("times_s", "joints", "targets", "reached"):
        if not np.isfinite(getattr(track, name)).all():
            raise MotionError(f"expected finite numbers in {name}, found NaN or infinity")
    return track


def _open_for_writing(path: Path) -> None:
    """Fail early and in one line, where Rerun would add a warning of its own on the terminal."""
    try:
        path.open("wb").close()
    except OSError as error:
        raise LogError(f"cannot write the recording '{path}': {error.strerror}") from error


def _load_urdf(urdf_text: str) -> UrdfTree:
    with tempfile.TemporaryDirectory() as directory:  # Rerun reads a URDF from files only
        path = Path(directory) / "robot.urdf"
        path.write_text(urdf_text, encoding="utf-8")
        try:
            return UrdfTree.from_file_path(path, entity_path_prefix="robot", static_transform_entity_path="robot/links")
        except RuntimeError as error:
            reason = " ".join(str(error).replace(str(path), "it").split())
            raise RobotError(f"the URDF cannot be read: {reason}") from error


def _find_joints(tree: UrdfTree, names: Sequence[str]) -> list[UrdfJoint]:
    movable = {joint.name: joint for joint in tree.joints() if joint.joint_type != "fixed"}
    missing = [name for name in names if name not in movable]
    if missing:
        raise JointError(f"expected joints of the robot, found '{missing[0]}'; it has {', '.join(sorted(movable))}")
    if len(set(names)) != len(names):
        raise JointError(f"expected each joint once, found {', '.join(names)}")
    return [movable[name] for name in names]


def _send_robot(recording: rr.RecordingStream, tree: UrdfTree, moving: Sequence[UrdfJoint], track: _Track) -> None:
    tree.log_urdf_to_recording(recording)
    root = rr.Transform3D(parent_frame=_WORLD, child_frame=tree.root_link().name)
    recording.log("robot/root", root, static=True)
    for joint, values in zip(moving, track.joints.T, strict=True):
        columns = joint.compute_transform_columns(values.tolist(), clamp=False)
        recording.send_columns(f"robot/moving/{joint.name}", [track.index], columns)


def _send_hands(recording: rr.RecordingStream, track: _Track) -> None:
    for i, hand in enumerate(HANDS):
        target, reached, colour = track.targets[:, i], track.reached[:, i], _HAND_COLOURS[i]
        path = rr.LineStrips3D([target], colors=[_TARGET_COLOUR], radii=[_PATH_RADIUS_M])
        recording.log(f"hands/{hand}/target_path", path, static=True)
        _send_point(recording, f"hands/{hand}/target", target, track, _TARGET_COLOUR, _TARGET_RADIUS_M)
        _send_point(recording, f"hands/{hand}/reached", reached, track, colour, _TRAIL_RADIUS_M)
        style = rr.SeriesLines(names=[f"{hand} hand"], colors=[colour], widths=[2.0])
        recording.log(f"error/{hand}", style, static=True)
        errors_cm = rr.Scalars.columns(scalars=track.errors_cm[:, i])
        recording.send_columns(f"error/{hand}", [track.index], errors_cm)


def _send_point(
    recording: rr.RecordingStream,
    entity: str,
    points: Floats,
    track: _Track,
    colour: tuple[int, int, int],
    radius_m: float,
) -> None:
    recording.log(entity, rr.Points3D.from_fields(colors=[colour], radii=[radius_m]), static=True)
    recording.send_columns(entity, [track.index], rr.Points3D.columns(positions=points))


def _send_joints(recording: rr.RecordingStream, moving: Sequence[UrdfJoint], track: _Track) -> None:
    """Send all joints as one entity: an entity each costs sixteen times as much to write."""
    units = ["m" if joint.joint_type == "prismatic" else "rad" for joint in moving]
    names = [f"{joint.name} [{unit}]" for joint, unit in zip(moving, units, strict=True)]
    recording.log("joints", rr.SeriesLines(names=names), static=True)
    columns = rr.Scalars.columns(scalars=track.joints.ravel()).partition([len(moving)] * len(track.times_s))
    recording.send_columns("joints", [track.index], columns)


def _blueprint(track: _Track) -> rrb.Blueprint:
    """Lay the recording out: the robot on the left, both plots on the right."""
    plots = rrb.Vertical(
        rrb.TimeSeriesView(
            origin="/error",
            name="Distance of the hands from their targets [cm]",
            axis_y=rrb.ScalarAxis(range=(0.0, 1.1 * max(track.errors_cm.max(), _LEAST_RANGE_CM))),
        ),
        # Fifteen names would cover the plot; the cursor shows the name of a line.
        rrb.TimeSeriesView(origin="/joints", name="Joint positions", plot_legend=rrb.PlotLegend(visible=False)),
    )
    return rrb.Blueprint(
        rrb.Horizontal(_scene(track), plots, column_shares=[3, 2]),
        rrb.TimePanel(timeline=TIMELINE, state="collapsed", play_state="playing", loop_mode="all"),
        collapse_panels=True,
    )


def _scene(track: _Track) -> rrb.Spatial3DView:
    """Look at the hands from ahead of the robot, which stands at the origin; the hands leave a trail up to now."""
    middle = track.targets.mean(axis=(0, 1))  # (3,)
    ahead = np.array([middle[0], middle[1], 0.0])
    distance = np.linalg.norm(ahead)
    ahead = ahead / distance if distance > 0.0 else np.array([1.0, 0.0, 0.0])
    side, up = np.array([-ahead[1], ahead[0], 0.0]), np.array([0.0, 0.0, 1.0])
    eye = middle + _EYE_M @ np.stack([ahead, side, up])
    past = rrb.VisibleTimeRanges(timeline=TIMELINE, start=_FOREVER, end=_NOW)
    return rrb.Spatial3DView(
        name="Robot: left hand blue, right hand orange, targets grey",
        defaults=[shape.from_fields(fill_mode="solid") for shape in (rr.Boxes3D, rr.Cylinders3D, rr.Ellipsoids3D)],
        overrides={f"hands/{hand}/reached": past for hand in HANDS},
        eye_controls=rrb.EyeControls3D(position=eye, look_target=middle, eye_up=up),
    )
