"""What somebody shows in the tests of demonstrations: a straight line of the right hand, as paths, CSV or poses."""

from pathlib import Path

import numpy as np

from pipeline.exploration.hand_paths import DemonstratedPaths
from pipeline.exploration.pose_track import HandPath
from pipeline.motions.motion import Motion
from pipeline.robot.config import load_robot
from recorders.messages.message_types import PoseStamped, String
from recorders.writing.writer import LogWriter

ROBOT = load_robot("asimo")
LEFT, RIGHT = ROBOT.centres[0], ROBOT.centres[1]
EPOCH_NS = 1_700_000_000_123_456_789  # a tracker's clock
TRACKER = "/tracker/wrist"


def shown_right(times_s: np.ndarray, points: np.ndarray) -> DemonstratedPaths:
    return DemonstratedPaths("shown", {"right": HandPath(times_s, points)}, {"kind": "test"})


def line_of(times_s: np.ndarray) -> np.ndarray:
    """A straight line, 0.1 m/s aside and 0.05 m/s up, from the right hand's centre."""
    line: np.ndarray = RIGHT + np.outer(times_s, [0.0, 0.1, 0.05])
    return line


def write_csv(path: Path, header: str, *columns: np.ndarray) -> Path:
    rows = [",".join(repr(float(value)) for value in row) for row in np.column_stack(columns)]
    path.write_text("\n".join([header, *rows]) + "\n")
    return path


def write_log(path: Path, poses: dict[str, list[PoseStamped]]) -> Path:
    with LogWriter(path, manifest={}) as writer:
        writer.write("/notes", String("hello"), log_time_ns=0)
        for topic, messages in poses.items():
            for pose in messages:
                writer.write(topic, pose, log_time_ns=pose.stamp_ns)
    return path


def poses_of(times_s: np.ndarray) -> list[PoseStamped]:
    stamps = EPOCH_NS + np.rint(times_s * 1e9).astype(np.int64)
    return [
        PoseStamped(int(stamp), point, frame_id="map") for stamp, point in zip(stamps, line_of(times_s), strict=True)
    ]


def check_is_line(motion: Motion, *, samples: int) -> None:
    assert len(motion) == samples
    np.testing.assert_allclose(motion.times_s, 0.1 * np.arange(samples), atol=1e-12)
    np.testing.assert_allclose(motion.targets[:, 1], line_of(motion.times_s), atol=2e-9)
    np.testing.assert_array_equal(motion.targets[:, 0], np.broadcast_to(LEFT, (samples, 3)))
