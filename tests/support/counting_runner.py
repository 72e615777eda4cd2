"""What runs golden cases where no learner is needed."""

import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from recorders.messages.message_types import Message
from recorders.reading.reader import LogReader
from recorders.ticks.joiner import join_ticks
from replay.golden.recipe import CaseSpec, EpochEnd, State, TickDigests


class CountingRunner:
    """A runner that learns nothing but how many ticks there were: golden checks know no learner."""

    def __init__(self, *, step: int = 1) -> None:
        self._step = step

    def learn(self, recipe: CaseSpec) -> Iterator[TickDigests | EpochEnd]:
        count = 0
        for epoch in range(recipe.schedule.epochs):
            for log in recipe.logs:
                for place, tick in enumerate(join_ticks(LogReader(log))):
                    count += self._step
                    digest = count.to_bytes(32, "little")
                    yield TickDigests(epoch, 0, "learn", log.name, place, tick.stamp_ns, b"s" * 32, b"o" * 32, digest)
            yield EpochEnd(epoch, {"count": np.array([float(count)])})

    def train(self, recipe: CaseSpec) -> dict[str, Any]:
        counts = [event.state["count"][0] for event in self.learn(recipe) if isinstance(event, EpochEnd)]
        return {"digest": str(counts[-1]), "errors_cm": counts}

    def simulate(self, log: Path, *, ticks: int) -> Iterator[tuple[str, Message]]:
        return iter(())

    def changed_robot(self, log: Path) -> str:
        return ""

    def physics_tolerance(self, log: Path) -> float | None:
        return None

    def pack(self, states: Sequence[State]) -> bytes:
        return json.dumps([state["count"].tolist() for state in states]).encode()

    def difference(self, packed: bytes, end: EpochEnd) -> tuple[str, str, str] | None:
        expected, found = json.loads(packed)[end.epoch], end.state["count"].tolist()
        return None if expected == found else ("count[0]", str(expected[0]), str(found[0]))
