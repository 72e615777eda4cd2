"""Specification of a golden case: logs, a schedule and a learner's settings, and the protocol of its runner."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from recorders.errors import ConfigError
from recorders.messages.message_types import Message
from replay.sources.schedule import Schedule
from replay.sources.scheduled import Replay
from replay.sources.session import RecordedSession

MAX_EPOCHS = 6
"""The state is stored at the end of each: more would make a case too large to have beside the code."""

MAX_CYCLES = 100
"""Of an epoch: a case may come from anyone, and is run on every change."""

MAX_CASE_BYTES = 300_000
"""A case lies beside the code that it guards."""

PHYSICS_TICKS = 64

LATER_RESULTS = frozenset({"hands_cm", "trials_hands_cm"})
"""Results of a run that are compared in the cases that have them: the first cases have none."""

State: TypeAlias = Mapping[str, NDArray[np.float64]]


@dataclass(frozen=True)
class CaseSpec:
    """The inputs of a run.

    Parameters
    ----------
    logs : tuple of Path
        Logs, presented in this order.
    learner : mapping
        Settings of the learner, plain JSON; only the runner knows what they mean.
    schedule : Schedule
        Epochs and phases; of a recorded session, those that it had.
    as_recorded : bool
        Whether the one log is a recorded session, whose own phase markers are followed.
    resume_after : int, optional
        The training stops after this many ticks, and a new learner goes on from its checkpoint.
    physics : bool
        Whether teacher and simulation are run again.

    Raises
    ------
    ConfigError
        If the numbers are out of range, or a recorded session is not one log.
    """

    logs: tuple[Path, ...]
    learner: Mapping[str, Any]
    schedule: Schedule
    as_recorded: bool = False
    resume_after: int | None = None
    physics: bool = False

    def __post_init__(self) -> None:
        if not self.logs or (self.as_recorded and len(self.logs) != 1):
            raise ConfigError(f"golden case: expected logs, one if it is a session, found {len(self.logs)}")
        if self.schedule.epochs > MAX_EPOCHS:
            raise ConfigError(f"golden case: expected at most {MAX_EPOCHS} epochs, found {self.schedule.epochs}")
        if self.schedule.cycles > MAX_CYCLES:
            raise ConfigError(f"golden case: expected at most {MAX_CYCLES} cycles, found {self.schedule.cycles}")
        if self.resume_after is not None and self.resume_after < 1:
            raise ConfigError(f"golden case: expected to resume after at least 1 tick, found {self.resume_after}")

    def source(self) -> Replay | RecordedSession:
        """Return the stream that these logs make; raises ReenactError if one of them does not fit."""
        if self.as_recorded:
            return RecordedSession(self.logs[0], epochs=self.schedule.epochs, topics=self.schedule.topics)
        return Replay(self.logs, self.schedule)


class TickDigests(NamedTuple):
    """A tick of a run, and digests of what the learner had become after it.

    Attributes
    ----------
    epoch, cycle : int
        Counted from 0.
    phase, log : str
        What the cycle is for; name of the log that is presented.
    tick : int
        Place in the presentation.
    stamp_ns : int
        Its stamp [ns].
    stream, outputs, state : bytes
        SHA-256 of everything taken in, of the outputs of the step that the tick completes, and of the state.
    """

    epoch: int
    cycle: int
    phase: str
    log: str
    tick: int
    stamp_ns: int
    stream: bytes
    outputs: bytes
    state: bytes


class EpochEnd(NamedTuple):
    """The state at the end of an epoch, and what names an element by its array and its place."""

    epoch: int
    state: State
    element_name: Callable[[str, tuple[int, ...]], str] | None = None


class Runner(Protocol):
    """Runs cases: the only thing that a golden check needs to know about learners and robots."""

    def learn(self, recipe: CaseSpec) -> Iterator[TickDigests | EpochEnd]:
        """Run step by step, and yield every tick and the end of every epoch."""

    def train(self, recipe: CaseSpec) -> dict[str, Any]:
        """Run as programs do, in pieces, and return what came of it: JSON, with errors under `errors_cm`.

        Errors of each hand, in the robot's order, are under `hands_cm`, and those of trials under `trials_hands_cm`.
        """

    def simulate(self, log: Path, *, ticks: int) -> Iterator[tuple[str, Message]]:
        """Yield topic and message of the first ticks that teacher and simulation make of a log's recipe now.

        Raises
        ------
        MissingExtra
            If what simulates is not installed.
        """

    def changed_robot(self, log: Path) -> str:
        """Return how the robot that `simulate` moves differs from the log's; the empty string if it does not."""

    def physics_tolerance(self, log: Path) -> float | None:
        """Return how far off `simulate` may be from a log [rad or m]; None: as far as the case has it.

        That is 0 where what the robot measures is on a grid, unless whoever leads it is not exact on every machine.
        """

    def pack(self, states: Sequence[State]) -> bytes:
        """Return the states at the ends of the epochs as the bytes of a file."""

    def difference(self, packed: bytes, end: EpochEnd) -> tuple[str, str, str] | None:
        """Name the first element that differs from what was packed: name, expected, found; None if none does."""
