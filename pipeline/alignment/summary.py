"""Account of an alignment: what was used, what was dropped and why, what is wrong with it."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from pipeline.alignment.blocks import Dropped
from pipeline.alignment.config import AlignmentConfig
from pipeline.alignment.sources import Choice
from pipeline.alignment.ticks import Aligner, Source, SourceCounts, Ticks
from pipeline.arrays import Floats
from recorders.text.quantities import seconds_text
from recorders.text.wording import names_text

_STILL_M = 1e-4  # a hand that goes no farther is not tracked while joints move
_MOVED_RAD = 0.05  # or m


@dataclass
class Extents:
    """Least and largest values of the sources of an alignment, over all ticks."""

    lowest: list[Floats]
    highest: list[Floats]

    @classmethod
    def of(cls, sources: tuple[Source, ...]) -> "Extents":
        """Return the extents before the first tick."""
        sizes = [source.kind.size for source in sources]
        return cls([np.full(size, np.inf) for size in sizes], [np.full(size, -np.inf) for size in sizes])

    def add(self, ticks: Ticks) -> None:
        """Take in some ticks."""
        for rank, values in enumerate(ticks.values):
            self.lowest[rank] = np.minimum(self.lowest[rank], values.min(axis=0))
            self.highest[rank] = np.maximum(self.highest[rank], values.max(axis=0))

    def moved(self, rank: int, size: int) -> float:
        """Return how far the first values of a source went, the largest of them."""
        return float((self.highest[rank][:size] - self.lowest[rank][:size]).max())


@dataclass(frozen=True)
class Summary:
    """What an alignment came to.

    Attributes
    ----------
    choice : Choice
        Its topics.
    config : AlignmentConfig
        Its settings.
    counts : tuple of SourceCounts
        What became of the messages of each source.
    made, missed, episodes : int
        Ticks that were made, those between them that were not, and the episodes that they are in.
    restarts : int
        How many times the clock of the stamps began anew.
    """

    choice: Choice
    config: AlignmentConfig
    counts: tuple[SourceCounts, ...]
    made: int
    missed: int
    episodes: int
    restarts: int

    @classmethod
    def of(cls, aligner: Aligner, choice: Choice, config: AlignmentConfig, *, cuts: int, restarts: int) -> "Summary":
        """Return the summary of an aligner that has taken in all messages: its ticks went back at `restarts`."""
        episodes = cuts + 1 if aligner.made else 0
        counts = tuple(aligner.counts)
        return cls(choice, config, counts, aligner.made, aligner.missed, episodes, max(restarts, aligner.restarts))

    def to_dict(self) -> dict[str, Any]:
        """Return the summary for JSON, and for a controller."""
        topics = {
            source.topic: {
                "as": source.ours,
                "used": counts.used,
                **({"dropped": _dropped(counts)} if counts.dropped else {}),
            }
            for source, counts in zip(self.choice.sources, self.counts, strict=True)
        }
        return {
            "ticks_at": self.choice.ticks_at,
            "ticks": self.made,
            "missed": self.missed,
            "episodes": self.episodes,
            **self.config.to_dict(),
            "topics": topics,
            "left_out": self.choice.left_out,
        }

    def lines(self, name: str) -> Iterator[str]:
        """Yield lines for whoever aligned a log of some name."""
        tolerance = seconds_text(self.config.nearness_ns)
        missed = f"; {self.missed} not made, as a topic had no message within {tolerance} s" if self.missed else ""
        episodes = "1 episode" if self.episodes == 1 else f"{self.episodes} episodes"
        yield f"{name}: aligned to {self.made} ticks {self.choice.ticks_at}, in {episodes}{missed}"
        for source, counts in zip(self.choice.sources, self.counts, strict=True):
            dropped = names_text(f"{count} {reason}" for reason, count in _dropped(counts).items())
            use = f"as {source.ours}" if source.ours else "for its stamps"
            yield f"  {source.topic} {use}: {counts.used} messages used" + (f"; dropped {dropped}" if dropped else "")
        if self.choice.left_out:
            left = names_text(f"{topic} ({count})" for topic, count in self.choice.left_out.items())
            yield f"  left out: {left}; --map TOPIC=OURS takes one in"

    def fault(self, extents: Extents) -> str:
        """Return what is wrong with the log as a whole, the empty string if nothing is."""
        for source, counts in zip(self.choice.sources, self.counts, strict=True):
            if not counts.used:
                return _no_samples(source, counts)
            if (out := counts.dropped[Dropped.LATE] + counts.dropped[Dropped.AHEAD]) > counts.used:
                return (
                    f"{source.topic}: expected stamps that rise in order of arrival, found {out} messages out of order "
                    f"and {counts.used} in order; take the times of recording with --clock log"
                )
        if self.restarts:
            return (
                "expected stamps of one clock, found a clock that began anew; take the times of recording with "
                "--clock log, or record its parts apart"
            )
        if not self.made:
            return self._no_ticks()
        return self._stands_still(extents)

    def _no_ticks(self) -> str:
        topics = [source.topic for source in self.choice.sources]
        spans = [(counts.first_ns or 0, counts.last_ns or 0) for counts in self.counts]
        late, early = (
            max(range(len(spans)), key=lambda rank: spans[rank][0]),
            min(range(len(spans)), key=lambda rank: spans[rank][1]),
        )
        if spans[late][0] > spans[early][1]:
            apart = spans[late][0] - spans[early][0]
            return (
                f"expected stamps of one clock, found those of {topics[late]} {seconds_text(apart)} s after those of "
                f"{topics[early]}, with nothing in common; give --latency {topics[late]}=SECONDS, or --clock log"
            )
        tolerance = seconds_text(self.config.nearness_ns)
        return (
            f"expected a tick with messages of {names_text(topics)} within {tolerance} s before it and after it, found "
            "none; give a larger --tolerance"
        )

    def _stands_still(self, extents: Extents) -> str:
        """Return which hand never moves while the joints do, if one does not."""
        sources = self.choice.sources
        joints = next(rank for rank, source in enumerate(sources) if source.ours and not source.turns)
        if extents.moved(joints, sources[joints].kind.size) < _MOVED_RAD:
            return ""
        for rank, source in enumerate(sources):
            if source.turns and source.ours and extents.moved(rank, 3) < _STILL_M:
                at = ", ".join(f"{value:g}" for value in extents.lowest[rank][:3].tolist())
                return (
                    f"{source.topic}: expected a hand that moves as the joints do, found it at ({at}) m all the time; "
                    "look at the tracker, or leave the topic out"
                )
        return ""


def _dropped(counts: SourceCounts) -> dict[str, int]:
    return {reason.text: counts.dropped[reason] for reason in Dropped if counts.dropped[reason]}


def _no_samples(source: Source, counts: SourceCounts) -> str:
    """Return why a topic has no message that can be used."""
    if not counts.dropped:
        return f"{source.topic}: expected messages, found none"
    reason, count = counts.dropped.most_common(1)[0]
    line = f"{source.topic}: expected messages that can be used, found {count} {reason.text}"
    if reason is Dropped.JOINTS_MISSING:
        return f"{source.topic}: expected all joints of the robot in a message, found {count} {reason.text}"
    if reason is Dropped.NO_STAMP:
        return f"{line}; take the times of recording with --clock log"
    if reason is Dropped.UNKNOWN_FRAME:
        return unknown_frame(source, counts)
    return f"{line}: {counts.first_error}" if reason is Dropped.UNREADABLE else line


def unknown_frame(source: Source, counts: SourceCounts) -> str:
    """Return a line on poses in a frame that is not known."""
    frames = names_text(counts.frames, limit=100)
    return (
        f"{source.topic}: expected poses in the robot's frame or one that /tf_static joins to it, found {frames}; give "
        f"--frame {source.topic}=x,y,z,qx,qy,qz,qw"
    )
