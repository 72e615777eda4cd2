"""A motion as a Rerun recording: the robot moving, its hands against their targets, and the plots beside them.

Analytics: Rerun's viewer and command line send usage data unless set not to. The library that this module uses writes
a file, or to a viewer, without starting any of that, which a test watches; see `rerun_scene.viewer` for the viewer.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import ArrayLike

from recorders.errors import LogError
from recorders.messages.validation import FloatArray
from recorders.rerun_scene.blueprint import motion_blueprint, stack_points
from recorders.rerun_scene.hands import FrontalPlane, HandScene
from recorders.rerun_scene.robot import RobotModel
from recorders.rerun_scene.track import Track

APPLICATION_ID = "reenact"

_FLUSH_S = 5.0  # how long a viewer that stalls may hold up the end
_FOOTER, _FOOTER_BYTES = b"FOOT", 12  # what stands in the last bytes of a whole recording: RRF2FOOT, and a count
_PROBE_BYTES = 65536  # more than a file's last block may still have room for
_MAGIC = b"RRF"  # then a digit, of the format: what every recording of Rerun's begins with


@dataclass(frozen=True)
class Destination:
    """The destination of a recording: a file, a viewer, or both.

    Parameters
    ----------
    path : Path, optional
        File (`.rrd`) to write; another recording there is replaced, a file of any other kind is not.
    url : str, optional
        A viewer that runs, such as `rerun+http://127.0.0.1:9876/proxy`.
    """

    path: Path | None = None
    url: str | None = None


@contextmanager
def open_recording(
    destination: Destination, *, recording_id: str | None, title: str, blueprint: rrb.Blueprint, kind: str = ""
) -> Iterator[rr.RecordingStream]:
    """Open a recording, which is complete at the end of the block; if the block fails, no file is left.

    Parameters
    ----------
    destination : Destination
        Where it goes.
    recording_id : str, optional
        Its identity; a new one if left out.
    title : str
        Its name in the viewer.
    blueprint : Blueprint
        The layout to show it in.
    kind : str
        Recordings of one kind share a layout in the viewer.

    Raises
    ------
    LogError
        The file cannot be written, or would take the place of one that is no recording.
    """
    if destination.path is not None:
        _open_for_writing(destination.path)
    application = f"{APPLICATION_ID} {kind}".strip()
    recording = rr.RecordingStream(application, recording_id=recording_id, send_properties=False)
    recording.set_log_time_enabled(False)  # the clock of the machine has no place in a result
    recording.set_log_tick_enabled(False)
    with _whole_or_none(destination.path):
        try:
            recording.set_sinks(*_sinks(destination), default_blueprint=blueprint)
            recording.send_recording_name(_in_unicode(title))
            yield recording
            recording.flush(timeout_sec=_FLUSH_S)
            recording.disconnect()  # writes the footer and closes the file
        except RuntimeError as error:  # what Rerun raises when the disk is full, or the viewer gone
            raise LogError(_complaint(destination, " ".join(str(error).split()))) from error
        if destination.path is not None and not _has_footer(
            destination.path
        ):  # of its last bytes Rerun reports nothing
            raise LogError(_complaint(destination, "it ended early"))


def record_motion(
    path: Path,
    *,
    urdf_text: str,
    joint_names: Sequence[str],
    times_ns: ArrayLike,
    joints: ArrayLike,
    targets: ArrayLike,
    reached: ArrayLike,
    title: str,
    plane: FrontalPlane | None = None,
    orientations: Mapping[str, tuple[FloatArray, FloatArray]] = MappingProxyType({}),
) -> None:
    """Write the recording (`.rrd`) of a robot following a motion; open it with `reenact view` or `rerun FILE`.

    The body moves by the joints alone: Rerun puts the links together from the URDF. The same input gives the same
    content under the same recording id, yet not the same bytes, for Rerun numbers its rows by the clock.

    Parameters
    ----------
    path : Path
        File to write; another recording there is replaced, a file of any other kind is not.
    urdf_text : str
        The robot; its root link is taken for the world frame.
    joint_names : sequence of str
        Names of the columns of `joints`; joints of the robot that are not named stay at zero.
    times_ns : array of int, shape (T,)
        Time of each sample [ns].
    joints : array, shape (T, n)
        Postures [rad or m].
    targets, reached : array, shape (T, hands, 3)
        Where each hand should be and where it was [m], world frame.
    title : str
        Name of the recording in the viewer.
    plane : FrontalPlane, optional
        The hands, and the plane in which they are seen from behind; left and right, x ahead, z up if left out.
    orientations : mapping of str to (array, array)
        Quaternions x, y, z, w of the target and as reached, shape (T, 4) each, of hands whose pose is controlled.

    Raises
    ------
    RobotError, JointError
        The URDF cannot be read; a joint is not in it, is named twice, or `joints` does not fit names and times.
    MotionError, LogError
        Times or positions are not of the right shape or finite; the file cannot be written, or another kind is there.
    """
    plane = plane or FrontalPlane()
    track = Track.checked(
        joint_count=len(joint_names),
        hand_count=len(plane.hands),
        times_ns=times_ns,
        joints=joints,
        targets=targets,
        reached=reached,
        orientations=orientations,
    )
    model, recording_id = RobotModel.load(urdf_text, joint_names), track.recording_id(urdf_text, *joint_names, title)
    send_motion(Destination(path), track, model, plane=plane, recording_id=recording_id, title=title)


def send_motion(
    destination: Destination,
    track: Track,
    model: RobotModel,
    *,
    plane: FrontalPlane,
    recording_id: str,
    title: str,
    kind: str = "",
    blueprint: rrb.Blueprint | None = None,
    more: Callable[[rr.RecordingStream], None] = lambda recording: None,
) -> None:
    """Send a whole motion, and whatever `more` adds to its recording; raises LogError as `open_recording` does."""
    laid_out = blueprint or motion_blueprint(
        stack_points(track.targets, track.reached),
        plane,
        joints=len(model.joints),
        top_cm=float(track.errors_cm[track.plotted].max()),
    )
    with open_recording(
        destination, recording_id=recording_id, title=title, blueprint=laid_out, kind=kind
    ) as recording:
        model.send_static(recording)
        model.send(recording, track.instants, track.joints)
        hands = HandScene(recording, plane).send_static()
        hands.send_target_paths(track.targets)
        hands.send(track.instants, track)
        more(recording)


@contextmanager
def _whole_or_none(path: Path | None) -> Iterator[None]:
    """Take the file away if the block does not come to its end."""
    try:
        yield
    except BaseException:
        if path is not None:
            path.unlink(missing_ok=True)
        raise


def _in_unicode(title: str) -> str:
    """Return a title, such as a file's name, with bytes that are no UTF-8 spelt out: Rerun takes no others."""
    return title.encode("utf-8", "surrogateescape").decode("utf-8", "backslashreplace")


def _complaint(destination: Destination, reason: str) -> str:
    if destination.path is None:
        return f"cannot write the recording to {destination.url}: {reason}"
    try:
        with destination.path.open("ab") as file:
            file.write(bytes(_PROBE_BYTES))
    except OSError as met:  # Rerun itself does not report what its writer met
        reason = met.strerror or reason
    return f"cannot write the recording '{destination.path}': {reason}"


def _has_footer(path: Path) -> bool:
    with path.open("rb") as file:
        file.seek(max(0, path.stat().st_size - _FOOTER_BYTES))
        return _FOOTER in file.read()


def _sinks(destination: Destination) -> Iterator[rr.FileSink | rr.GrpcSink]:
    if destination.path is not None:
        yield rr.FileSink(destination.path)
    if destination.url is not None:
        yield rr.GrpcSink(destination.url)


def check_place(path: Path, *, overwrite: bool = True) -> None:
    """Check that a recording can be written as `path`, before the work that makes it.

    A recording may take the place of an empty file and, with `overwrite`, of another one; of nothing else.

    Raises
    ------
    LogError
        If the folder is missing, or `path` names something else than a file, or a file that is no recording or may not
        be replaced.
    """
    try:
        _check_replaceable(path, overwrite=overwrite)
    except (OSError, ValueError) as error:  # ValueError: a name that no system can have
        raise LogError(f"cannot write the recording '{path}': {getattr(error, 'strerror', None) or error}") from error


def _check_replaceable(path: Path, *, overwrite: bool) -> None:
    if not path.parent.is_dir():
        raise LogError(f"cannot write the recording '{path}': expected a folder '{path.parent}', found none")
    if not path.exists():
        return
    if not path.is_file():
        raise LogError(f"cannot write the recording '{path}': expected the name of a file, found something else")
    with path.open("rb") as file:
        begin = file.read(len(_MAGIC))
    if begin not in (b"", _MAGIC):
        raise LogError(
            f"cannot write the recording '{path}': there is a file that is no recording of Rerun's, which stays as it "
            "is; choose another name"
        )
    if begin and not overwrite:
        raise LogError(f"{path} exists: choose another name, or replace it with --overwrite")


def _open_for_writing(path: Path) -> None:
    """Fail early and in one line, where Rerun would add a warning of its own on the terminal."""
    check_place(path)
    try:
        path.unlink(missing_ok=True)  # a link of that name is replaced, not followed
        path.open("xb").close()
    except OSError as error:
        raise LogError(f"cannot write the recording '{path}': {error.strerror}") from error
