"""The hand is where the mounting offset has it from the marker, and the tracker's base from the world, whatever way."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from lab import MAPPED, changed, recording
from scipy.spatial.transform import Rotation
from sessions import write_foreign

from pipeline.alignment.aligned_log import AlignedLog
from pipeline.alignment.config import AlignmentConfig
from pipeline.alignment.live import LiveAligner
from pipeline.robot.config import load_robot
from recorders.cdr.codec import decode
from recorders.containers.opening import open_log
from recorders.messages.message_types import PoseStamped
from recorders.messages.record import RecordedMessage

BASE = np.array([0.4, -0.2, 1.1]), Rotation.from_rotvec([0.3, -0.8, 1.9])
MOUNT = np.array([0.02, 0.07, -0.11]), Rotation.from_rotvec([-1.2, 0.4, 0.6])
TICK, RENAMES = ("/hand/tip/measured", "/sample/joint_states"), {"/tracker": "/hand/tip/measured"}


def option(pose: tuple[Any, Rotation]) -> str:
    return "/tracker=" + ",".join(repr(float(number)) for number in (*pose[0], *pose[1].as_quat()))


def marked(robot: Path) -> list[RecordedMessage]:
    """Return a recording whose tracker sees a marker on the hand, in its own base's axes; the hand turns as it goes."""

    def seen(pose: PoseStamped, stamp: int) -> PoseStamped:
        hand = Rotation.from_rotvec(2.0 * pose.position)
        marker = hand * MOUNT[1].inv()
        place = pose.position - marker.apply(MOUNT[0])
        in_base = BASE[1].inv()
        turn = (in_base * marker).as_quat()
        return PoseStamped(stamp, in_base.apply(place - BASE[0]), orientation=turn, frame_id="base")

    return changed(recording(robot), "/tracker", seen)


def test_the_hand_is_found_from_the_marker_in_the_file_and_live(robot: Path) -> None:
    frames, offsets = ({"/tracker": (*map(float, (*p, *r.as_quat())),)} for p, r in (BASE, MOUNT))
    config = AlignmentConfig(frames=frames, offsets=offsets)
    plain, known = recording(robot), load_robot(robot)
    log = write_foreign(robot.parent / "marked.mcap", marked(robot))
    by_file = AlignedLog(open_log(log), known, config=config, renames=RENAMES, wanted=TICK)
    hands = [decode(r.type, r.data) for r in by_file.records(topics=TICK[:1])]
    expected = [decode(r.type, r.data) for r in plain if r.topic == "/tracker"]
    for hand, true in zip(hands, expected, strict=True):
        assert isinstance(hand, PoseStamped)
        assert isinstance(true, PoseStamped)
        np.testing.assert_allclose(hand.position, true.position, atol=1e-12)
        turn = Rotation.from_quat(hand.orientation) * Rotation.from_rotvec(2.0 * true.position).inv()
        assert turn.magnitude() < 1e-12
    live = LiveAligner(known, config, renames=RENAMES, tick=TICK)
    assert [made for record in open_log(log) for made in live.feed(record)] == list(by_file)
    assert by_file.manifest["alignment"]["offsets"] == {"/tracker": list(offsets["/tracker"])}


def test_a_controller_names_the_offset_and_reaches_as_without_it(
    robot: Path, trained: Any, log: Path, tmp_path: Path
) -> None:
    seen = write_foreign(tmp_path / "seen.mcap", marked(robot))
    words = (*MAPPED, "--frame", option(BASE), "--offset", option(MOUNT))
    found, _, controller = trained(seen, *words)
    plain, _, _ = trained(log, *MAPPED)
    assert found["train_cm"] == pytest.approx(plain["train_cm"], rel=1e-3)
    assert list(controller.provenance["logs"][0]["alignment"]["offsets"]) == ["/tracker"]
    wrong, _, _ = trained(seen, *MAPPED, "--frame", option(BASE))
    assert wrong["train_cm"] > 2.0 * plain["train_cm"]
