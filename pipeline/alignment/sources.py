"""Choice of the topics of a log from which ticks come: as mapped, by our names, or the only ones of their kind."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import islice

from pipeline.alignment.blocks import joints_kind, pose_kind
from pipeline.alignment.config import DEFAULT_PERIOD_NS, AlignmentConfig
from pipeline.alignment.ticks import Source
from recorders.cdr.codec import decode_as
from recorders.containers.reader import Reader
from recorders.errors import LogError, MessageError
from recorders.messages.message_types import JointState, PoseStamped
from recorders.messages.topics import JOINT_STATES, SAMPLE_JOINTS, is_target
from recorders.text.wording import names_text

_LOOKED_AT = 50  # messages of a topic, for the names of joints


@dataclass(frozen=True)
class Choice:
    """Topics of a log that are aligned, and whose stamps are the ticks.

    Attributes
    ----------
    sources : tuple of Source
        Hands and joints, and last the topic of the ticks if it is none of them.
    period_ns : int or None
        Ticks at multiples of this [ns], or at the stamps of a source.
    pivot : int
        Place of that source; of the joints, where there is a period.
    left_out : dict of str to int
        Topics that are not used, and how many messages they have.
    """

    sources: tuple[Source, ...]
    period_ns: int | None
    pivot: int
    left_out: dict[str, int]

    @property
    def ticks_at(self) -> str:
        """Where the ticks are, in words."""
        if self.period_ns is None:
            return f"at the stamps of {self.sources[self.pivot].topic}"
        return f"every {self.period_ns / 1e6:g} ms"


class TopicChoice:
    """Chooses topics of one log.

    Parameters
    ----------
    reader : Reader
        The log.
    renames : mapping of str to str
        Our topic names for those that the log uses.
    joints : sequence of str
        The joints of the robot.
    """

    def __init__(self, reader: Reader, renames: Mapping[str, str], joints: Sequence[str]) -> None:
        self._reader, self._joints = reader, tuple(joints)
        self._there = {topic: kind for topic, kind in reader.topics.items() if reader.counts.get(topic)}
        self._renames = {foreign: ours for foreign, ours in renames.items() if foreign in self._there}

    def choose(self, wanted: Sequence[str], config: AlignmentConfig) -> Choice:
        """Return the topics that ticks are made of.

        Parameters
        ----------
        wanted : sequence of str
            Our names of the topics of a tick. Hands that are not all there are left out.
        config : AlignmentConfig
            Ticks that are asked for.

        Raises
        ------
        LogError
            If targets are wanted and not there, no topic has the joints of the robot, a topic is of another type or of
            two, or the topic of the ticks is not there.
        """
        found = {ours: self._named(ours) for ours in wanted if ours != SAMPLE_JOINTS}
        self._check_targets([ours for ours, topic in found.items() if topic is None])
        hands = [] if None in found.values() else [(topic or "", ours) for ours, topic in found.items()]
        sources = [Source(topic, ours, pose_kind()) for topic, ours in hands]
        joints = self._topic_of_joints()
        sources.append(Source(joints, SAMPLE_JOINTS, joints_kind(self._joints)))
        pivot = next((rank for rank, source in enumerate(sources) if is_target(source.ours)), 0 if hands else None)
        period_ns = config.period_ns
        if config.ticks_of is not None:
            pivot = self._pivot(config.ticks_of, sources)
        elif period_ns is not None or pivot is None:
            period_ns, pivot = period_ns or DEFAULT_PERIOD_NS, len(hands)
        for source in sources:
            self._check_type(source)
        used = {source.topic for source in sources}
        left_out = {topic: self._reader.counts[topic] for topic in self._there if topic not in used}
        return Choice(tuple(sources), period_ns, pivot, left_out)

    def _check_targets(self, missing: Sequence[str]) -> None:
        """Check that no target is missing: nothing else can take its place."""
        if targets := [ours for ours in missing if is_target(ours)]:
            poses = sorted(topic for topic, kind in self._there.items() if kind == PoseStamped.TYPE)
            choice = f"rename one of {names_text(poses)} with --map" if poses else "it has no pose to rename"
            raise LogError(
                f"{self._reader.path}: expected messages on {names_text(targets)}, found none; {choice}, or learn "
                "from hands as measured or from joints alone, with --rule forward-inverse"
            )

    def _named(self, ours: str) -> str | None:
        """Return the topic that is renamed to one of ours, or is called so."""
        mapped = [foreign for foreign, name in self._renames.items() if name == ours]
        if len(mapped) > 1:
            raise LogError(f"{self._reader.path}: --map: expected one topic for {ours}, found {names_text(mapped)}")
        if mapped:
            return mapped[0]
        return ours if ours in self._there and ours not in self._renames else None

    def _topic_of_joints(self) -> str:
        """Return the topic of the joints: as mapped, else `/joint_states`, else the one that has the robot's."""
        if SAMPLE_JOINTS in self._renames.values():
            return self._named(SAMPLE_JOINTS) or SAMPLE_JOINTS
        found = {topic: self._joints_of(topic) for topic, kind in self._there.items() if kind == JointState.TYPE}
        fitting = [topic for topic, names in found.items() if names is not None and names >= set(self._joints)]
        usually: tuple[str, ...] = (JOINT_STATES, SAMPLE_JOINTS, *(fitting if len(fitting) == 1 else ()))
        for usual in usually:
            if usual in fitting:
                return usual
        if fitting:
            raise LogError(
                f"{self._reader.path}: expected one topic with the joints of the robot, found {names_text(fitting)}; "
                f"choose with --map TOPIC={SAMPLE_JOINTS}"
            )
        others = [
            f"{topic} without {names_text([joint for joint in self._joints if joint not in names], limit=200)}, "
            f"with {names_text(sorted(names), limit=200)}"
            for topic, names in found.items()
            if names
        ]
        raise LogError(
            f"{self._reader.path}: expected a topic of {JointState.TYPE} with the joints of the robot, "
            f"{names_text(self._joints, limit=300)}; found {names_text(others) or 'none'}"
        )

    def _joints_of(self, topic: str) -> frozenset[str]:
        """Return the joints in the message, of the first ones of a topic, that has most of the robot's, or most."""
        best: frozenset[str] = frozenset()
        for record in islice(self._reader.records(topics=[topic]), _LOOKED_AT):
            try:
                names = frozenset(decode_as(JointState, record.data).name)
            except MessageError:
                continue
            best = max(best, names, key=lambda joints: (len(joints & set(self._joints)), len(joints)))
        return best

    def _pivot(self, topic: str, sources: list[Source]) -> int:
        """Return the place of the source of the ticks, which is put at the end if it is none yet."""
        for rank, source in enumerate(sources):
            if topic in (source.topic, source.ours):
                return rank
        kinds = {PoseStamped.TYPE: pose_kind(), JointState.TYPE: joints_kind(())}
        kind = kinds.get(self._there.get(topic, ""))
        if kind is None:
            others = sorted(name for name, found in self._there.items() if found in kinds)
            raise LogError(
                f"{self._reader.path}: --ticks-of: expected a topic of joints or poses, found {topic}; there are: "
                f"{names_text(others) or 'none'}"
            )
        sources.append(Source(topic, "", kind))
        return len(sources) - 1

    def _check_type(self, source: Source) -> None:
        wanted = source.kind.message.TYPE
        types = {channel.type for channel in self._reader.channels if channel.topic == source.topic}
        if len(types) > 1:
            raise LogError(
                f"{self._reader.path}: {source.topic}: expected messages of one type, found {names_text(sorted(types))}"
            )
        if (found := self._there[source.topic]) not in ("", wanted):
            raise LogError(f"{self._reader.path}: {source.topic}: expected {wanted}, found {found[:80]!r}")
