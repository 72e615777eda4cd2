"""Our logs in the readers that others wrote, each with the values compared."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import Reader

from recorders.cdr.codec import decode
from recorders.cdr.rosbags_types import to_rosbags, typestore
from recorders.messages.message_types import JointState, PoseStamped
from recorders.messages.topics import LEFT_TARGET, SAMPLE_JOINTS
from recorders.reading.reader import LogReader


@pytest.fixture
def ours(log):
    """Every message of the log as our own reader and codec give it: (topic, log time, message)."""
    return [(item.topic, item.log_time_ns, decode(item.type, item.data)) for item in LogReader(log)]


def flat(value):
    """Return a message of any library as nested lists, in the order of its fields."""
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, list | tuple):
        return [flat(item) for item in value]
    names = getattr(value, "__dataclass_fields__", None) or getattr(value, "__slots__", None)
    if names is None:
        return value
    return [flat(getattr(value, name)) for name in names if name != "__msgtype__"]


def test_rosbags_reads_every_value(log, ours):
    with Reader(log) as reader:
        found = [
            (connection.topic, time, flat(typestore().deserialize_cdr(data, connection.msgtype)))
            for connection, time, data in reader.messages()
        ]
    assert found == [(topic, time, flat(to_rosbags(message))) for topic, time, message in ours]


def test_rosbags_finds_its_types_in_our_schemas(log, ours):
    with AnyReader([log]) as reader:
        found = [
            (connection.topic, time, flat(reader.deserialize(data, connection.msgtype)))
            for connection, time, data in reader.messages()
        ]
    assert found == [(topic, time, flat(to_rosbags(message))) for topic, time, message in ours]


def test_mcap_ros2_support_reads_every_value(log, ours):
    with log.open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        found = [
            (channel.topic, message.log_time, flat(decoded))
            for _, channel, message, decoded in reader.iter_decoded_messages(log_time_order=False)
        ]
    assert found == [(topic, time, flat(to_rosbags(message))) for topic, time, message in ours]


RERUN = """
import json, sys
from rerun.chunk import McapReader
found = {}
for chunk in McapReader(sys.argv[1]).stream():
    batch = chunk.to_record_batch()
    names = set(batch.schema.names)
    for column in names & set(sys.argv[2:]):
        if "message_log_time" in names:
            times = batch.column("message_log_time").cast("int64").to_pylist()
            rows = zip(times, batch.column(column).to_pylist(), strict=True)
            found.setdefault(chunk.entity_path + " " + column, []).extend(rows)
print(json.dumps({key: sorted(rows) for key, rows in found.items()}))
"""


@pytest.fixture
def quiet_environment(tmp_path):
    """An environment in which Rerun sends no analytics: it sends none on CI, and a home of its own says so too."""
    kept = {key: value for key, value in os.environ.items() if key != "FORCE_RERUN_ANALYTICS"}
    environment = {**kept, "CI": "true", "HOME": str(tmp_path), "XDG_CONFIG_HOME": str(tmp_path / "config")}
    return {**environment, "XDG_DATA_HOME": str(tmp_path / "data")}


@pytest.mark.extra
def test_rerun_imports_every_joint_and_target(log, ours, quiet_environment):
    columns = ["Scalars:scalars", "SeriesLines:names", "InstancePoses3D:translations", "InstancePoses3D:quaternions"]
    done = subprocess.run(
        [sys.executable, "-c", RERUN, log, *columns], env=quiet_environment, check=True, capture_output=True, text=True
    )
    found = json.loads(done.stdout)
    joints = [(time, message) for topic, time, message in ours if topic == SAMPLE_JOINTS]
    assert all(isinstance(message, JointState) for _, message in joints)
    scalars = [[time, message.position.tolist()] for time, message in joints]
    assert found[f"{SAMPLE_JOINTS}/position Scalars:scalars"] == scalars
    assert found[f"{SAMPLE_JOINTS}/position SeriesLines:names"] == [[time, list(m.name)] for time, m in joints]
    targets = [(time, message) for topic, time, message in ours if topic == LEFT_TARGET]
    assert all(isinstance(message, PoseStamped) for _, message in targets)
    single = [[time, [message.position.astype(np.float32).tolist()]] for time, message in targets]  # Rerun's precision
    assert found[f"{LEFT_TARGET} InstancePoses3D:translations"] == single
    upright = [[time, [[0.0, 0.0, 0.0, 1.0]]] for time, _ in targets]
    assert found[f"{LEFT_TARGET} InstancePoses3D:quaternions"] == upright


@pytest.mark.extra
def test_reruns_own_command_converts_the_log(log, tmp_path, quiet_environment):
    command = shutil.which("rerun", path=Path(sys.executable).parent)
    assert command is not None
    out = tmp_path / "log.rrd"
    subprocess.run([command, "mcap", "convert", log, "-o", out], env=quiet_environment, check=True, capture_output=True)
    stats = subprocess.run(
        [command, "rrd", "stats", out], env=quiet_environment, check=True, capture_output=True, text=True
    )
    assert "num_entity_paths" in stats.stdout
    assert not (tmp_path / "config").exists()  # no analytics identity was made
