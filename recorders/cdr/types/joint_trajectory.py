"""trajectory_msgs/msg/JointTrajectory."""

from collections.abc import Iterator
from dataclasses import KW_ONLY, dataclass, field
from typing import ClassVar

from recorders.cdr.message_format import HEADER_PARTS, MessageFormat, Value, header_fields, write_header
from recorders.cdr.stream import CdrReader, CdrWriter
from recorders.messages.message_types import EMPTY
from recorders.messages.validation import FloatArray, items, names, stamp, store, text, vector, wrong

_RUNS = ("positions", "velocities", "accelerations", "effort")


@dataclass(frozen=True, slots=True, eq=False)
class TrajectoryPoint:
    """Joints at one time of a trajectory (trajectory_msgs/msg/JointTrajectoryPoint).

    Parameters
    ----------
    time_from_start_ns : int
        When they are to be there, counted from the trajectory's stamp [ns].
    positions : array, shape (n,) or (0,)
        Joint positions [rad or m].
    velocities, accelerations, effort : array, shape (n,) or (0,)
        Joint velocities [rad/s or m/s], accelerations [rad/s^2 or m/s^2] and efforts [N m or N].

    Raises
    ------
    MessageError
        If a field has the wrong type.
    """

    time_from_start_ns: int
    positions: FloatArray = field(default_factory=lambda: EMPTY)
    _: KW_ONLY
    velocities: FloatArray = field(default_factory=lambda: EMPTY)
    accelerations: FloatArray = field(default_factory=lambda: EMPTY)
    effort: FloatArray = field(default_factory=lambda: EMPTY)

    def __post_init__(self) -> None:
        """Check every field and copy the arrays."""
        store(self, "time_from_start_ns", stamp(self, "time_from_start_ns", self.time_from_start_ns))
        for part in _RUNS:
            store(self, part, vector(self, part, getattr(self, part)))


@dataclass(frozen=True, slots=True, eq=False)
class JointTrajectory:
    """Joints by name at several times (trajectory_msgs/msg/JointTrajectory).

    Parameters
    ----------
    stamp_ns : int
        When it begins [ns]; 0 means at once.
    joint_names : tuple of str
        Joint names, length n.
    points : tuple of TrajectoryPoint
        Where the joints are to be, in order of time.
    frame_id : str
        Usually empty for joints.

    Raises
    ------
    MessageError
        If a field has the wrong type, or an array of a point does not match the names.
    """

    TYPE: ClassVar[str] = "trajectory_msgs/msg/JointTrajectory"
    stamp_ns: int
    joint_names: tuple[str, ...]
    points: tuple[TrajectoryPoint, ...]
    _: KW_ONLY
    frame_id: str = ""

    def __post_init__(self) -> None:
        """Check every field."""
        store(self, "stamp_ns", stamp(self, "stamp_ns", self.stamp_ns))
        store(self, "joint_names", names(self, self.joint_names))
        points = tuple(items(self, "points", self.points))
        for place, point in enumerate(points):
            if not isinstance(point, TrajectoryPoint):
                raise wrong(self, "points", "TrajectoryPoint", type(point).__name__)
            for part in _RUNS:
                if (count := len(getattr(point, part))) not in (0, len(self.joint_names)):
                    expected = f"{len(self.joint_names)} values, one per joint name"
                    raise wrong(self, f"points[{place}].{part}", expected, f"{count}")
        store(self, "points", points)
        text(self, "frame_id", self.frame_id)


def _read(reader: CdrReader) -> JointTrajectory:
    stamp_ns, frame_id = reader.time_ns(), reader.string()
    joint_names = tuple(reader.string() for _ in range(reader.uint32()))
    points = tuple(_read_point(reader) for _ in range(reader.uint32()))
    return JointTrajectory(stamp_ns, joint_names, points, frame_id=frame_id)


def _read_point(reader: CdrReader) -> TrajectoryPoint:
    runs = {part: reader.float64s(reader.uint32()) for part in _RUNS}
    return TrajectoryPoint(reader.time_ns(), **runs)


def _write(writer: CdrWriter, message: JointTrajectory) -> None:
    write_header(writer, message.stamp_ns, message.frame_id)
    writer.uint32(len(message.joint_names))
    for name in message.joint_names:
        writer.string(name)
    writer.uint32(len(message.points))
    for point in message.points:
        for part in _RUNS:
            values: FloatArray = getattr(point, part)
            writer.uint32(len(values))
            writer.float64s(values)
        writer.time_ns(point.time_from_start_ns)


def _fields(message: JointTrajectory) -> Iterator[tuple[str, Value]]:
    yield from header_fields(message)
    for place, name in enumerate(message.joint_names):
        yield f"joint_names[{place}]", name
    for number, point in enumerate(message.points):
        for part in _RUNS:
            values: list[float] = getattr(point, part).tolist()
            for place, (value, name) in enumerate(zip(values, message.joint_names, strict=False)):
                yield f"points[{number}].{part}[{place}] ({name})", value
        yield f"points[{number}].time_from_start", point.time_from_start_ns


_PARTS = (*HEADER_PARTS, "joint_names", *(f"points.{part}" for part in (*_RUNS, "time_from_start")))

FORMAT = MessageFormat(JointTrajectory, _read, _write, _fields, _PARTS)
