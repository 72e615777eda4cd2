"""One small session in every container: joints, a tracked pose, its odometry and a transform, as a lab records them."""

import json
from collections.abc import Callable, Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as BagWriter
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

from recorders.cdr.codec import decode, encode
from recorders.cdr.rosbags_types import schema_text
from recorders.messages.message_types import JointState, Message, PoseStamped, TFMessage, TransformStamped
from recorders.reading.reader import LogReader

JOINTS, POSE, ODOMETRY, TF = "/joint_states", "/tracker/pose", "/odom", "/tf"
START_NS = 1_700_000_000_000_000_000
COUNT = 40

ROS1 = get_typestore(Stores.ROS1_NOETIC)
ROS2 = get_typestore(Stores.ROS2_HUMBLE)


def messages(count: int = COUNT) -> list[tuple[str, Message, int]]:
    """Return topic, message and log time [ns] of the session, in order of log time; of odometry the pose."""
    found: list[tuple[str, Message, int]] = []
    for step in range(count):
        stamp_ns = START_NS + step * 10_000_000
        joints = JointState(
            stamp_ns, ("elbow", "wrist"), np.array([0.01, 0.02]) * step, velocity=np.array([np.nan, 0.5]), frame_id="b"
        )
        pose = PoseStamped(
            stamp_ns + 500, np.array([0.1, -0.2, 1e-3 * step]), orientation=np.array([0, 0, 0.6, 0.8]), frame_id="odom"
        )
        transform = TransformStamped(stamp_ns, "odom", "tool", pose.position, pose.orientation)
        found += [(JOINTS, joints, stamp_ns + 1000), (POSE, pose, stamp_ns + 1000), (ODOMETRY, pose, stamp_ns + 2000)]
        if step % 4 == 0:
            found.append((TF, TFMessage((transform,)), stamp_ns + 3000))
    return found


def ros_value(store: Typestore, topic: str, message: Message) -> tuple[str, Any]:
    """Return the type and the message of rosbags that stands for one of ours in a store."""

    def new(kind: str, *values: Any, **fields: Any) -> Any:
        return store.types[kind](*values, **fields)

    def header(stamp_ns: int, frame_id: str) -> Any:
        stamp = new("builtin_interfaces/msg/Time", *divmod(stamp_ns, 10**9))
        seq = {"seq": 7} if store is ROS1 else {}
        return new("std_msgs/msg/Header", stamp=stamp, frame_id=frame_id, **seq)

    def point(kind: str, values: Any) -> Any:
        return new(f"geometry_msgs/msg/{kind}", *map(float, values))

    match message:
        case JointState():
            arrays = (np.array(part) for part in (message.position, message.velocity, message.effort))
            return message.TYPE, new(
                message.TYPE, header(message.stamp_ns, message.frame_id), list(message.name), *arrays
            )
        case PoseStamped():
            pose = new(
                "geometry_msgs/msg/Pose", point("Point", message.position), point("Quaternion", message.orientation)
            )
            if topic != ODOMETRY:
                return message.TYPE, new(message.TYPE, header(message.stamp_ns, message.frame_id), pose)
            covariance = np.arange(36.0)
            twist = new("geometry_msgs/msg/Twist", point("Vector3", [1, 2, 3]), point("Vector3", [4, 5, 6]))
            return "nav_msgs/msg/Odometry", new(
                "nav_msgs/msg/Odometry",
                header(message.stamp_ns, message.frame_id),
                "tool",
                new("geometry_msgs/msg/PoseWithCovariance", pose, covariance),
                new("geometry_msgs/msg/TwistWithCovariance", twist, covariance),
            )
        case TFMessage(transforms=transforms):
            parts = [
                new(
                    TransformStamped.TYPE,
                    header(part.stamp_ns, part.frame_id),
                    part.child_frame_id,
                    new(
                        "geometry_msgs/msg/Transform",
                        point("Vector3", part.translation),
                        point("Quaternion", part.rotation),
                    ),
                )
                for part in transforms
            ]
            kind = "tf2_msgs/msg/TFMessage"
            return kind, new(kind, parts)
    raise AssertionError(message)


def raw(count: int = COUNT, *, ros: int = 2) -> Iterator[tuple[str, str, bytes, int]]:
    """Yield topic, type, bytes and log time of the session as ROS 1 or 2 would have recorded them."""
    store = _with_tf(ROS1) if ros == 1 else ROS2
    for topic, message, time_ns in messages(count):
        kind, value = ros_value(store, topic, message)
        write = store.serialize_ros1 if ros == 1 else store.serialize_cdr
        yield topic, kind, bytes(write(value, kind)), time_ns


def _with_tf(store: Typestore) -> Typestore:
    if "tf2_msgs/msg/TFMessage" not in store.types:
        from rosbags.typesys import get_types_from_msg

        store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", "tf2_msgs/msg/TFMessage"))
    return store


@cache
def definition(kind: str) -> dict[str, Any]:
    """Return text and hash of a type, which take rosbags a while."""
    return {"msgdef": ROS2.generate_msgdef(kind, ros_version=2)[0], "rihs01": ROS2.hash_rihs01(kind)}


def bag_folder(
    path: Path,
    *,
    storage: StoragePlugin = StoragePlugin.SQLITE3,
    mode: CompressionMode = CompressionMode.NONE,
    count: int = COUNT,
) -> Path:
    """Write the session as a rosbag2 folder."""
    writer = BagWriter(path, version=9, storage_plugin=storage)
    writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        channels = {}
        for topic, kind, data, time_ns in raw(count):
            if topic not in channels:
                channels[topic] = writer.add_connection(topic, kind, **definition(kind))
            writer.write(channels[topic], time_ns, data)
    return path


def ros1_bag(path: Path, *, compression: str | None = None, chunk_bytes: int = 2000, order: Any = None) -> Path:
    """Write the session as a ROS 1 bag; `order` puts its messages in another order of the file."""
    writer = Ros1Writer(path)
    if compression:
        writer.set_compression(Ros1Writer.CompressionFormat[compression])
    writer.chunk_threshold = chunk_bytes
    found = list(raw(ros=1))
    with writer:
        channels = {}
        for topic, kind, data, time_ns in found if order is None else order(found):
            if topic not in channels:
                channels[topic] = writer.add_connection(topic, kind, typestore=_with_tf(ROS1))
            writer.write(channels[topic], time_ns, data)
    return path


def as_bag(log: Path, path: Path) -> Path:
    """Write the messages of a log of ours as a rosbag2 folder, or as a ROS 1 bag if the path ends so."""
    ros1 = path.suffix == ".bag"
    store = _with_tf(ROS1) if ros1 else ROS2
    writer: Any = Ros1Writer(path) if ros1 else BagWriter(path, version=9)
    with writer:
        channels = {}
        for topic, kind, data, _, time_ns in LogReader(log):
            if topic not in channels:
                channels[topic] = writer.add_connection(topic, kind, typestore=store)
            if ros1:
                data = bytes(store.serialize_ros1(ros_value(store, topic, decode(kind, data))[1], kind))
            writer.write(channels[topic], time_ns, data)
    return path


def mcap_file(
    path: Path, rows: Sequence[tuple[str, str, str, tuple[str, bytes], bytes, int]], *, profile: str = ""
) -> Path:
    """Write messages as topic, encoding, name of the schema, its encoding and text, bytes and log time, by mcap."""
    with path.open("wb") as file:
        writer = McapWriter(file, compression=CompressionType.ZSTD, chunk_size=4000)
        writer.start(profile)
        channels: dict[str, int] = {}
        for topic, encoding, name, (kind, text), data, time_ns in rows:
            if topic not in channels:
                schema = writer.register_schema(name, kind, text)
                channels[topic] = writer.register_channel(topic, encoding, schema)
            writer.add_message(channels[topic], time_ns, data, time_ns)
        writer.finish()  # type: ignore[no-untyped-call]
    return path


def ros1_mcap(path: Path) -> Path:
    """Write the session as ROS 1 messages in MCAP."""
    store = _with_tf(ROS1)
    rows = []
    for topic, kind, data, time_ns in raw(ros=1):
        text, _ = store.generate_msgdef(kind)
        rows.append((topic, "ros1", kind.replace("/msg/", "/"), ("ros1msg", text.encode()), data, time_ns))
    return mcap_file(path, rows, profile="ros1")


def cdr_mcap(path: Path) -> Path:
    """Write the session as our types in MCAP, of mcap's own writer."""
    rows = [
        (topic, "cdr", message.TYPE, ("ros2msg", schema_text(message.TYPE).encode()), encode(message), time_ns)
        for topic, message, time_ns in messages()
    ]
    return mcap_file(path, rows, profile="ros2")


def _time(stamp_ns: int) -> dict[str, int]:
    seconds, rest = divmod(stamp_ns, 10**9)
    return {"sec": seconds, "nsec": rest}


def _axes(names: str, values: Any) -> dict[str, float]:
    return dict(zip(names, map(float, values), strict=True))


def foxglove_json(path: Path) -> Path:
    """Write the session as Foxglove's JSON types in MCAP."""
    rows = []
    for topic, message, time_ns in messages():
        match message:
            case JointState():
                name = "foxglove.JointStates"
                joints = [
                    {"name": joint, "position": position, **({} if velocity is None else {"velocity": velocity})}
                    for joint, position, velocity in zip(
                        message.name, message.position.tolist(), [None, 0.5], strict=True
                    )
                ]
                fields = {"timestamp": _time(message.stamp_ns), "joints": joints}
            case PoseStamped():
                name = "foxglove.PoseInFrame"
                pose = {
                    "position": _axes("xyz", message.position),
                    "orientation": _axes("xyzw", message.orientation),
                }
                fields = {"timestamp": _time(message.stamp_ns), "frame_id": message.frame_id, "pose": pose}
            case TFMessage(transforms=transforms):
                name = "foxglove.FrameTransforms"
                fields = {
                    "transforms": [
                        {
                            "timestamp": _time(part.stamp_ns),
                            "parent_frame_id": part.frame_id,
                            "child_frame_id": part.child_frame_id,
                            "translation": _axes("xyz", part.translation),
                            "rotation": _axes("xyzw", part.rotation),
                        }
                        for part in transforms
                    ]
                }
        rows.append((topic, "json", name, ("jsonschema", b"{}"), json.dumps(fields).encode(), time_ns))
    return mcap_file(path, rows)


def foxglove_protobuf(path: Path) -> Path:
    """Write the session as Foxglove's protobuf types in MCAP."""
    from foxglove.messages import (
        FrameTransform,
        FrameTransforms,
        JointStates,
        Pose,
        PoseInFrame,
        Quaternion,
        Timestamp,
        Vector3,
    )
    from foxglove.messages import JointState as FoxgloveJoint

    def stamp(stamp_ns: int) -> Timestamp:
        return Timestamp(*divmod(stamp_ns, 10**9))

    def vector(values: Any) -> Vector3:
        return Vector3(**_axes("xyz", values))

    def quaternion(values: Any) -> Quaternion:
        return Quaternion(**_axes("xyzw", values))

    rows = []
    for topic, message, time_ns in messages():
        match message:
            case JointState():
                joints = [
                    FoxgloveJoint(name=joint, position=position, velocity=velocity)
                    for joint, position, velocity in zip(
                        message.name, message.position.tolist(), [None, 0.5], strict=True
                    )
                ]
                value: Any = JointStates(timestamp=stamp(message.stamp_ns), joints=joints)
            case PoseStamped():
                pose = Pose(position=vector(message.position), orientation=quaternion(message.orientation))
                value = PoseInFrame(timestamp=stamp(message.stamp_ns), frame_id=message.frame_id, pose=pose)
            case TFMessage(transforms=transforms):
                value = FrameTransforms(
                    transforms=[
                        FrameTransform(
                            timestamp=stamp(part.stamp_ns),
                            parent_frame_id=part.frame_id,
                            child_frame_id=part.child_frame_id,
                            translation=vector(part.translation),
                            rotation=quaternion(part.rotation),
                        )
                        for part in transforms
                    ]
                )
        schema = type(value).get_schema()
        rows.append((topic, "protobuf", schema.name, (schema.encoding, schema.data), value.encode(), time_ns))
    return mcap_file(path, rows)


def _of_folder(**options: Any) -> Callable[[Path], Path]:
    return lambda folder: bag_folder(folder / "bag", **options)


CONTAINERS: dict[str, Callable[[Path], Path]] = {
    "mcap": lambda folder: cdr_mcap(folder / "log.mcap"),
    "ros1 mcap": lambda folder: ros1_mcap(folder / "ros1.mcap"),
    "foxglove json": lambda folder: foxglove_json(folder / "json.mcap"),
    "foxglove protobuf": lambda folder: foxglove_protobuf(folder / "protobuf.mcap"),
    "db3 folder": _of_folder(),
    "db3 folder, packed files": _of_folder(mode=CompressionMode.FILE),
    "db3 folder, packed messages": _of_folder(mode=CompressionMode.MESSAGE),
    "mcap folder": _of_folder(storage=StoragePlugin.MCAP),
    "mcap folder, packed chunks": _of_folder(storage=StoragePlugin.MCAP, mode=CompressionMode.STORAGE),
    "mcap folder, packed files": _of_folder(storage=StoragePlugin.MCAP, mode=CompressionMode.FILE),
    "mcap folder, packed messages": _of_folder(storage=StoragePlugin.MCAP, mode=CompressionMode.MESSAGE),
    "db3 file": lambda folder: bag_folder(folder / "bag") / "bag.db3",
    "ros1 bag": lambda folder: ros1_bag(folder / "log.bag"),
    "ros1 bag, bz2": lambda folder: ros1_bag(folder / "log.bag", compression="BZ2"),
    "ros1 bag, lz4": lambda folder: ros1_bag(folder / "log.bag", compression="LZ4"),
}
"""What writes the session in each container, into a folder."""
