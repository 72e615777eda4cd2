"""The topics of a session: name, type and rank of each, as data."""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from recorders.messages.message_types import Clock, Float64MultiArray, JointState, PoseStamped, String, TFMessage


@dataclass(frozen=True, slots=True)
class Topic:
    """A topic of the table.

    Parameters
    ----------
    name : str
        ROS topic name, with its leading slash.
    type : str
        ROS 2 type name.
    rank : int
        Place in the canonical order: messages are ordered by stamp, then by rank.
    description : str
        Content of its messages, with units.
    """

    name: str
    type: str
    rank: int
    description: str


HAND_NAME = re.compile(r"[a-z][a-z0-9_]{0,63}", re.ASCII)
"""Names that a hand may have: part of its topics and of the names of its results."""

_HAND = re.compile(rf"/hand/(?P<hand>{HAND_NAME.pattern})/(?P<what>target|measured)", re.ASCII)


def hand_target(hand: str) -> str:
    """Return the topic of a hand's target."""
    return f"/hand/{hand}/target"


def hand_measured(hand: str) -> str:
    """Return the topic of a hand as measured."""
    return f"/hand/{hand}/measured"


def commanded_tick(hands: Sequence[str]) -> tuple[str, ...]:
    """Return the topics of a tick as commanded: targets of the hands, in their order, and joints."""
    return (*map(hand_target, hands), SAMPLE_JOINTS)


def reached_tick(hands: Sequence[str]) -> tuple[str, ...]:
    """Return the topics of a tick as reached: the hands as measured, in their order, and joints."""
    return (*map(hand_measured, hands), SAMPLE_JOINTS)


LEFT_TARGET = hand_target("left")
RIGHT_TARGET = hand_target("right")
SAMPLE_JOINTS = "/sample/joint_states"
LEFT_MEASURED = hand_measured("left")
RIGHT_MEASURED = hand_measured("right")
JOINT_STATES = "/joint_states"
JOINT_COMMANDS = "/joint_commands"
SESSION_PHASE = "/session/phase"
LEARNER_OUTPUT = "/learner/output"
LEARNER_ERROR = "/learner/error"
LEARNER_DIGEST = "/learner/digest"
LEARNER_STATUS = "/learner/status"
ROBOT_DESCRIPTION = "/robot_description"
ROBOT_CONFIG = "/robot_config"
TF = "/tf"
TF_STATIC = "/tf_static"
CLOCK = "/clock"
CONTROLLER_DEVIATION = "/controller/deviation"

_ROWS = (
    (LEFT_TARGET, PoseStamped.TYPE, "commanded position of the left hand [m], world frame"),
    (RIGHT_TARGET, PoseStamped.TYPE, "commanded position of the right hand [m], world frame"),
    (SAMPLE_JOINTS, JointState.TYPE, "joints at the tick, stamped with it: what the learner reads"),
    (LEFT_MEASURED, PoseStamped.TYPE, "position that the left hand reached at the tick [m], world frame"),
    (RIGHT_MEASURED, PoseStamped.TYPE, "position that the right hand reached at the tick [m], world frame"),
    (JOINT_STATES, JointState.TYPE, "joints at the robot's own rate"),
    (JOINT_COMMANDS, JointState.TYPE, "joints that the teacher or the learned controller asked for"),
    (SESSION_PHASE, String.TYPE, "JSON: run, epoch, cycle, phase, log"),
    (LEARNER_OUTPUT, Float64MultiArray.TYPE, "outputs of the learner"),
    (LEARNER_ERROR, Float64MultiArray.TYPE, "hand errors of the learner [m]"),
    (LEARNER_DIGEST, String.TYPE, "JSON: stream and state digest"),
    (LEARNER_STATUS, String.TYPE, "JSON: counts"),
    (ROBOT_DESCRIPTION, String.TYPE, "the robot's URDF, once"),
    (TF, TFMessage.TYPE, "poses of the robot's links, for viewers"),
    (CLOCK, Clock.TYPE, "the simulation's time"),
    (CONTROLLER_DEVIATION, Float64MultiArray.TYPE, "how far off each hand may be after a command, as predicted [m]"),
    (ROBOT_CONFIG, String.TYPE, "the robot's TOML, once: hands, joints and ranges that its URDF does not name"),
)

ROBOT_TEXTS = {"toml": ROBOT_CONFIG, "urdf": ROBOT_DESCRIPTION}
"""Topics on which a robot publishes its two files, once, for late joiners too."""

TOPICS: dict[str, Topic] = {name: Topic(name, kind, rank, text) for rank, (name, kind, text) in enumerate(_ROWS)}
"""The table, by name."""

COMMANDED_TICK = commanded_tick(("left", "right"))
"""Topics of a tick as commanded of two hands, left and right: of schedules and streams that name none."""

LEARNER_TOPICS: tuple[Topic, ...] = tuple(TOPICS[name] for name in COMMANDED_TICK)


def is_measured(topic: str) -> bool:
    """Whether a topic is of a hand as measured: robots publish these at a rate of their own."""
    return topic.startswith("/hand/") and topic.endswith("/measured")


def type_of(topic: str) -> str:
    """Return the ROS 2 type name of a topic of the table or of any hand, the empty string for any other."""
    known = TOPICS.get(topic)
    if known is not None:
        return known.type
    return PoseStamped.TYPE if topic.startswith("/hand/") and _HAND.fullmatch(topic) else ""


def hands_among(topics: Iterable[str]) -> tuple[str, ...]:
    """Return the names of the hands of which topics are targets or measured positions, in order of the topics."""
    return tuple(dict.fromkeys(match["hand"] for topic in topics if (match := _HAND.fullmatch(topic))))


def is_target(topic: str) -> bool:
    """Whether a topic carries the target of a hand."""
    match = _HAND.fullmatch(topic)
    return match is not None and match["what"] == "target"


def is_of_tick(topic: str) -> bool:
    """Whether messages of a topic are parts of ticks as commanded: targets of hands, and joints at the tick."""
    return topic == SAMPLE_JOINTS or is_target(topic)


def canonical_place(topic: str) -> tuple[int, str]:
    """Return what messages of one stamp are ordered by: the rank of their topic, and then its name.

    Hands have the ranks of the table's, those of a kind one after the other; topics that are not ours come last, alike.
    """
    match = _HAND.fullmatch(topic)
    if match is not None:
        return TOPICS[LEFT_TARGET if match["what"] == "target" else LEFT_MEASURED].rank, topic
    known = TOPICS.get(topic)
    return (len(TOPICS), "") if known is None else (known.rank, topic)
