"""What became of the messages of a log is stated in full, and what is wrong with it as a whole is one line."""

from collections import Counter

import numpy as np
import pytest

from pipeline.alignment.blocks import Dropped, joints_kind, pose_kind
from pipeline.alignment.config import AlignmentConfig
from pipeline.alignment.frames import StaticFrames
from pipeline.alignment.sources import Choice
from pipeline.alignment.summary import Extents, Summary
from pipeline.alignment.ticks import Aligner, Source, SourceCounts, Ticks

MS = 10**6
HANDS = tuple(Source(f"/{side}", f"/hand/{side}/measured", pose_kind()) for side in ("left", "right"))
JOINTS = Source("/arm", "/sample/joint_states", joints_kind(("a", "b")))
CLOCK = Source("/camera", "", pose_kind())
SOURCES = (*HANDS, JOINTS, CLOCK)


def counts(used: int = 9, *, first_ns: int | None = 0, last_ns: int | None = 9 * MS, **dropped: int) -> SourceCounts:
    reasons = Counter({Dropped[reason]: count for reason, count in dropped.items()})
    return SourceCounts(used, reasons, first_ns, last_ns)


def summary(*found: SourceCounts, made: int = 5, missed: int = 0, episodes: int = 1, restarts: int = 0) -> Summary:
    """Return a summary of the first sources, of all others as many messages."""
    choice = Choice(SOURCES, None, 0, {"/left": 1, "/notes": 7} if missed else {})
    every = (*found, *[counts()] * (len(SOURCES) - len(found)))
    return Summary(choice, AlignmentConfig(tolerance_ns=20 * MS), every, made, missed, episodes, restarts)


def extents(*, hand: float = 1.0, joint: float = 1.0) -> Extents:
    """Return extents over two ticks, between which joints and a hand, which turns, go so far."""
    found = Extents.of(SOURCES)
    for step in (0.0, 1.0):
        pose = np.array([[0.25, 0.5, 0.0, 0.0, 0.0, 0.0, 1.0]])
        moved = pose + np.array([0.0, 0.0, step * hand, step, 0.0, 0.0, 0.0])
        joints = np.array([[0.0, step * joint]])
        found.add(Ticks(np.array([int(step)]), (pose + step, moved, joints, pose), np.zeros(1, np.bool_)))
    return found


def test_lines_name_ticks_and_topics() -> None:
    cut_short = summary(counts(3, LATE=2, NO_STAMP=1), missed=4, episodes=2)
    assert [*cut_short.lines("lab.mcap")] == [
        "lab.mcap: aligned to 5 ticks at the stamps of /left, in 2 episodes; 4 not made, as a topic had no message "
        "within 0.02 s",
        "  /left as /hand/left/measured: 3 messages used; dropped 1 without a stamp, 2 late, no later by stamp than "
        "one before",
        "  /right as /hand/right/measured: 9 messages used",
        "  /arm as /sample/joint_states: 9 messages used",
        "  /camera for its stamps: 9 messages used",
        "  left out: /left (1), /notes (7); --map TOPIC=OURS takes one in",
    ]
    whole = [*summary().lines("lab.mcap")]
    assert whole[0] == "lab.mcap: aligned to 5 ticks at the stamps of /left, in 1 episode"
    assert len(whole) == 1 + len(SOURCES)


def test_json_names_what_was_dropped_where_anything_was() -> None:
    found = summary(counts(3, LATE=2), missed=4, episodes=2).to_dict()
    assert found == {
        "ticks_at": "at the stamps of /left",
        "ticks": 5,
        "missed": 4,
        "episodes": 2,
        "tolerance_ns": 20 * MS,
        "topics": {
            "/left": {
                "as": "/hand/left/measured",
                "used": 3,
                "dropped": {"late, no later by stamp than one before": 2},
            },
            "/right": {"as": "/hand/right/measured", "used": 9},
            "/arm": {"as": "/sample/joint_states", "used": 9},
            "/camera": {"as": "", "used": 9},
        },
        "left_out": {"/left": 1, "/notes": 7},
    }


@pytest.mark.parametrize(
    ("dropped", "line"),
    [
        ({}, "expected messages, found none"),
        ({"NO_LENGTH": 3, "LATE": 2}, "expected messages that can be used, found 3 with a quaternion of zero length"),
        (
            {"JOINTS_MISSING": 3},
            "expected all joints of the robot in a message, found 3 without all joints of the robot",
        ),
        (
            {"NO_STAMP": 3},
            "expected messages that can be used, found 3 without a stamp; take the times of recording with --clock log",
        ),
        ({"UNREADABLE": 3}, "expected messages that can be used, found 3 unreadable: too short"),
        (
            {"UNKNOWN_FRAME": 3},
            "expected poses in the robot's frame or one that /tf_static joins to it, found cam, map; give "
            "--frame /right=x,y,z,qx,qy,qz,qw",
        ),
    ],
)
def test_a_topic_without_a_message_that_can_be_used_is_named(dropped: dict[str, int], line: str) -> None:
    nothing = counts(0, first_ns=None, last_ns=None, **dropped)
    nothing.first_error, nothing.frames = "too short", {"cam": None, "map": None}
    assert summary(counts(), nothing, made=0).fault(extents()) == f"/right: {line}"


def test_messages_out_of_order_are_a_fault_if_they_are_more_than_those_in_order() -> None:
    assert summary(counts(5, LATE=2, AHEAD=3)).fault(extents()) == ""
    assert summary(counts(), counts(5, LATE=3, AHEAD=3)).fault(extents()) == (
        "/right: expected stamps that rise in order of arrival, found 6 messages out of order and 5 in order; take the "
        "times of recording with --clock log"
    )


def test_a_clock_that_began_anew_is_a_fault() -> None:
    assert (
        summary(restarts=1).fault(extents()).startswith("expected stamps of one clock, found a clock that began anew")
    )


def test_topics_that_have_no_time_in_common_are_named() -> None:
    early, late = counts(first_ns=MS, last_ns=2000 * MS), counts(first_ns=3500 * MS, last_ns=4500 * MS)
    between = counts(first_ns=1000 * MS, last_ns=5000 * MS)
    assert summary(late, early, between, between, made=0).fault(extents()) == (
        "expected stamps of one clock, found those of /left 3.499 s after those of /right, with nothing in common; "
        "give --latency /left=SECONDS, or --clock log"
    )
    assert (
        summary(early, late, between, between, made=0)
        .fault(extents())
        .startswith("expected stamps of one clock, found those of /right 3.499 s after those of /left")
    )


@pytest.mark.parametrize("first_ns", [1999 * MS, 2000 * MS])
def test_topics_that_are_nowhere_near_enough_need_more_tolerance(first_ns: int) -> None:
    early, late = counts(first_ns=MS, last_ns=2000 * MS), counts(first_ns=first_ns, last_ns=4500 * MS)
    assert summary(late, early, late, early, made=0).fault(extents()) == (
        "expected a tick with messages of /left, /right, /arm, /camera within 0.02 s before it and after it, found "
        "none; give a larger --tolerance"
    )


@pytest.mark.parametrize(
    ("hand", "joint", "stands"),
    [
        (0.99e-4, 0.051, True),
        (1e-4, 0.051, False),
        (1.01e-4, 0.051, False),
        (0.0, 0.049, False),
        (0.0, 0.05, True),
    ],
)
def test_a_hand_that_stands_still_while_the_joints_move_is_a_fault(hand: float, joint: float, stands: bool) -> None:
    """A tenth of a millimetre is no movement, and a twentieth of a radian is one; a topic of stamps alone may stand."""
    line = (
        "/right: expected a hand that moves as the joints do, found it at (0.25, 0.5, 0) m all the time; look at the "
        "tracker, or leave the topic out"
    )
    assert summary().fault(extents(hand=hand, joint=joint)) == (line if stands else "")


def test_an_alignment_without_ticks_has_no_episodes() -> None:
    config, choice = AlignmentConfig(), Choice(SOURCES, None, 0, {})
    aligner = Aligner(SOURCES, config, period_ns=None, pivot=0, frames=StaticFrames(["world"]))
    found = Summary.of(aligner, choice, config, cuts=0, restarts=2)
    assert (found.made, found.missed, found.episodes, found.restarts) == (0, 0, 0, 2)


def test_extents_are_over_all_ticks() -> None:
    found = Extents.of(SOURCES[2:3])
    for values in ([[1.0, 5.0], [2.0, 9.0]], [[-1.0, 6.0]], [[0.0, 7.0]]):
        block = np.array(values)
        found.add(Ticks(np.arange(len(block)), (block,), np.zeros(len(block), np.bool_)))
    assert (found.lowest[0].tolist(), found.highest[0].tolist()) == ([-1.0, 5.0], [2.0, 9.0])
    assert (found.moved(0, 1), found.moved(0, 2)) == (3.0, 4.0)
