"""Topics are chosen as mapped, by our names, or as the only ones of their kind; what is missing is one line."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sessions import write_foreign

from pipeline.alignment import sources as module
from pipeline.alignment.config import AlignmentConfig
from pipeline.alignment.sources import Choice, TopicChoice
from recorders.cdr.codec import encode
from recorders.containers.opening import open_log
from recorders.errors import LogError
from recorders.messages.message_types import JointState, PoseStamped, String
from recorders.messages.record import RecordedMessage

ARM = ("shoulder", "elbow")
HANDS = ("/hand/left/measured", "/hand/right/measured")
TARGETS = ("/hand/left/target", "/hand/right/target")
JOINTS = "/sample/joint_states"


def pose(topic: str) -> RecordedMessage:
    return RecordedMessage(topic, PoseStamped.TYPE, encode(PoseStamped(1, np.zeros(3))), 0, 1)


def joints(topic: str, names: tuple[str, ...] = ARM) -> RecordedMessage:
    return RecordedMessage(topic, JointState.TYPE, encode(JointState(1, names, np.zeros(len(names)))), 0, 1)


def note(topic: str) -> RecordedMessage:
    return RecordedMessage(topic, String.TYPE, encode(String("x")), 0, 1)


def chosen(
    tmp_path: Path,
    *records: Any,
    wanted: Any = (*HANDS, JOINTS),
    renames: Mapping[str, str] | None = None,
    **config: Any,
) -> Choice:
    log = open_log(write_foreign(tmp_path / "log.mcap", records))
    return TopicChoice(log, renames or {}, ARM).choose(wanted, AlignmentConfig(**config))


def named(choice: Choice) -> list[tuple[str, str]]:
    return [(source.topic, source.ours) for source in choice.sources]


BOTH = [(HANDS[0], HANDS[0]), (HANDS[1], HANDS[1]), ("/joint_states", JOINTS)]


def test_topics_are_those_of_our_names(tmp_path: Path) -> None:
    choice = chosen(tmp_path, note("/notes"), note("/notes"), *map(pose, HANDS), joints("/joint_states"), pose("/x"))
    assert named(choice) == BOTH
    assert [source.kind.size for source in choice.sources] == [7, 7, 2]
    assert (choice.period_ns, choice.pivot, choice.ticks_at) == (None, 0, "at the stamps of /hand/left/measured")
    assert choice.left_out == {"/notes": 2, "/x": 1}


def test_the_ticks_are_those_of_the_first_target_before_any_hand(tmp_path: Path) -> None:
    wanted = (*HANDS, *TARGETS[1:], JOINTS)
    choice = chosen(tmp_path, *map(pose, wanted[:3]), joints("/joint_states"), wanted=wanted)
    assert (choice.pivot, choice.period_ns, choice.ticks_at) == (2, None, "at the stamps of /hand/right/target")


@pytest.mark.parametrize(
    ("config", "period_ns", "pivot", "text"),
    [
        ({"period_ns": 12_500_000}, 12_500_000, 2, "every 12.5 ms"),
        ({"ticks_of": HANDS[1]}, None, 1, "at the stamps of /hand/right/measured"),
        ({"ticks_of": JOINTS}, None, 2, "at the stamps of /joint_states"),
        ({"ticks_of": "/joint_states"}, None, 2, "at the stamps of /joint_states"),
        ({"ticks_of": "/camera"}, None, 3, "at the stamps of /camera"),
        ({"ticks_of": "/wheel"}, None, 3, "at the stamps of /wheel"),
    ],
)
def test_ticks_are_where_they_are_asked_for(
    tmp_path: Path, config: Any, period_ns: int | None, pivot: int, text: str
) -> None:
    others = pose("/camera"), joints("/wheel", ("w",))
    choice = chosen(tmp_path, *map(pose, HANDS), joints("/joint_states"), *others, **config)
    assert (choice.period_ns, choice.pivot, choice.ticks_at) == (period_ns, pivot, text)
    assert named(choice) == BOTH + ([(config["ticks_of"], "")] if pivot == 3 else [])
    assert choice.sources[-1].kind.size == {"/camera": 7, "/wheel": 0}.get(config.get("ticks_of", ""), 2)
    assert set(choice.left_out) == {"/camera", "/wheel"} - {config.get("ticks_of")}


def test_hands_that_are_not_all_there_are_left_out(tmp_path: Path) -> None:
    """Joints alone then make ticks, ten a second."""
    choice = chosen(tmp_path, pose(HANDS[0]), joints("/joint_states"))
    assert named(choice) == BOTH[2:]
    assert (choice.period_ns, choice.pivot, choice.ticks_at) == (10**8, 0, "every 100 ms")
    assert choice.left_out == {HANDS[0]: 1}


def test_mapped_topics_count_before_those_of_our_names(tmp_path: Path) -> None:
    renames = {"/tracker": HANDS[0], "/arm": JOINTS, "/nowhere": HANDS[1]}
    records = *map(pose, ("/tracker", *HANDS)), joints("/joint_states"), joints("/arm", ("elbow",))
    choice = chosen(tmp_path, *records, renames=renames)
    assert named(choice) == [("/tracker", HANDS[0]), (HANDS[1], HANDS[1]), ("/arm", JOINTS)]
    swapped = chosen(tmp_path, *records, renames={HANDS[0]: HANDS[1], HANDS[1]: HANDS[0]})
    assert named(swapped)[:2] == [(HANDS[1], HANDS[0]), (HANDS[0], HANDS[1])]
    one = chosen(tmp_path, *records, renames={HANDS[0]: HANDS[1]}, wanted=(HANDS[1], JOINTS))
    assert named(one)[0] == (HANDS[0], HANDS[1])
    moved = chosen(tmp_path, *records, renames={HANDS[0]: "/aside"})
    assert named(moved) == [("/joint_states", JOINTS)]


@pytest.mark.parametrize(
    ("records", "topic"),
    [
        ([joints("/joint_states"), joints(JOINTS)], "/joint_states"),
        ([joints("/joint_states", ("wheel",)), joints(JOINTS), joints("/arm")], JOINTS),
        ([joints("/joint_states", ("wheel",)), joints("/arm", (*ARM, "finger")), joints("/leg", ("elbow",))], "/arm"),
    ],
)
def test_joints_are_those_of_the_usual_topic_or_of_the_only_one(tmp_path: Path, records: Any, topic: str) -> None:
    assert named(chosen(tmp_path, *records)) == [(topic, JOINTS)]


def test_joints_are_looked_for_in_the_first_messages_of_a_topic(tmp_path: Path) -> None:
    """A gripper may share it, and messages that cannot be read are passed over."""
    others = [joints("/arm", ("finger",)), joints("/arm")._replace(data=b"\0\1\0\0cut")] * 24
    assert named(chosen(tmp_path, *others, joints("/arm"), joints("/arm", ("finger", "thumb"))))[0][0] == "/arm"
    with pytest.raises(LogError, match=r"found /arm without shoulder, elbow, with finger"):
        chosen(tmp_path, *others, *others[:2], joints("/arm"))
    assert module._LOOKED_AT == 50


@pytest.mark.parametrize(
    ("records", "options", "line"),
    [
        (
            [joints("/a"), joints("/b")],
            {},
            "expected one topic with the joints of the robot, found /a, /b; choose with",
        ),
        (
            [
                joints("/a", ("elbow", "toe")),
                joints("/a", ("x", "y", "z")),
                joints("/c", ("wheel", "axle")),
                joints("/d", ()),
            ],
            {},
            "shoulder, elbow; found /a without shoulder, with elbow, toe, /c without shoulder, elbow, with axle, wheel",
        ),
        ([note("/joint_states")], {}, "with the joints of the robot, shoulder, elbow; found none"),
        (
            [*map(pose, HANDS), joints("/joint_states")],
            {
                "renames": {HANDS[0]: "/hand/tip/measured", HANDS[1]: "/hand/tip/measured"},
                "wanted": ("/hand/tip/measured",),
            },
            "--map: expected one topic for /hand/tip/measured, found /hand/left/measured, /hand/right/measured",
        ),
        (
            [*map(pose, ("/b", "/a", TARGETS[0])), joints("/joint_states")],
            {"wanted": (*HANDS, *TARGETS, JOINTS)},
            "messages on /hand/right/target, found none; rename one of /a, /b, /hand/left/target with --map, or learn",
        ),
        (
            [joints("/joint_states")],
            {"wanted": (*TARGETS, JOINTS)},
            "expected messages on /hand/left/target, /hand/right/target, found none; it has no pose to rename, or",
        ),
        (
            [joints("/joint_states"), note("/notes"), pose("/b"), pose("/a")],
            {"ticks_of": "/notes"},
            "--ticks-of: expected a topic of joints or poses, found /notes; there are: /a, /b, /joint_states",
        ),
        (
            [joints("/joint_states"), note("/tip")],
            {"renames": {"/tip": "/hand/tip/measured"}, "wanted": ("/hand/tip/measured", JOINTS)},
            f"/tip: expected {PoseStamped.TYPE}, found '{String.TYPE}'",
        ),
    ],
)
def test_what_is_missing_or_not_clear_is_one_line(tmp_path: Path, records: Any, options: Any, line: str) -> None:
    with pytest.raises(LogError) as error:
        chosen(tmp_path, *records, **options)
    assert line in str(error.value)


def test_a_topic_without_a_type_is_taken_to_be_of_the_right_one(tmp_path: Path) -> None:
    records = *(pose(topic)._replace(type="") for topic in HANDS), joints("/joint_states")
    assert named(chosen(tmp_path, *records)) == BOTH
