"""Independent re-implementation of the stream of a golden case, to check the engine."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import zip_longest

from recorders.cdr.codec import decode, encode
from recorders.messages.message_types import String
from recorders.messages.phase import Phase
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import SESSION_PHASE, TOPICS
from recorders.reading.reader import LogReader
from replay.diff.divergence import first_divergence
from replay.golden.case import Case
from replay.golden.finding import LEARNING, Finding, of_message
from replay.golden.recipe import CaseSpec
from replay.sources.scheduled import typed


def altered_stream(case: Case) -> Finding | None:
    """Return the first message at which the stream of the present program is not that of the case."""
    streams = expected_stream(case), case.recipe.source().stream()
    for expected, found in zip_longest(*map(_by_marker, streams), fillvalue=[]):
        divergence = first_divergence(expected, found)
        if divergence is not None:
            finding = of_message(LEARNING, divergence)
            return replace(finding, place={**_cycle_of(expected or found, case), **finding.place})
    return None


def expected_stream(case: Case) -> Iterator[RecordedMessage]:
    """Yield the messages of the run, phase markers included."""
    recipe = case.recipe
    inputs = recipe.schedule.topics
    if recipe.as_recorded:
        yield from map(typed, LogReader(recipe.logs[0]).records(topics=(*inputs, SESSION_PHASE), file_order=True))
        return
    presentations = enumerate(_presentations(recipe, len(case.logs)))
    for number, (epoch, cycle, phase, log) in presentations:
        marker = Phase(str(case.expected.get("run")), epoch, cycle, phase, case.logs[log].ticks_sha256)
        yield RecordedMessage(SESSION_PHASE, TOPICS[SESSION_PHASE].type, encode(marker.to_message()), number, 0)
        yield from map(typed, LogReader(recipe.logs[log]).records(topics=inputs))


def _by_marker(stream: Iterator[RecordedMessage]) -> Iterator[list[RecordedMessage]]:
    """Yield presentations: a phase marker and what follows it up to the next."""
    presentation: list[RecordedMessage] = []
    for message in stream:
        if message.topic == SESSION_PHASE and presentation:
            yield presentation
            presentation = []
        presentation.append(message)
    yield presentation


def _cycle_of(presentation: list[RecordedMessage], case: Case) -> dict[str, str | int]:
    """Epoch, cycle, phase and log of a presentation; cycles repeat the sequences and stamps of their messages."""
    marker = decode(presentation[0].type, presentation[0].data) if presentation else None
    if not isinstance(marker, String):
        return {}
    phase = Phase.from_message(marker)
    names = {log.ticks_sha256: log.name for log in case.logs}
    log = names.get(phase.log, case.logs[0].name)  # a recorded session is one log, and its markers name another
    return {"epoch": phase.epoch, "cycle": phase.cycle, "phase": phase.phase, "log": log}


def _presentations(recipe: CaseSpec, logs: int) -> Iterator[tuple[int, int, str, int]]:
    phases = [phase for phase, cycles in recipe.schedule.phases for _ in range(cycles)]
    for epoch in range(recipe.schedule.epochs):
        for cycle, phase in enumerate(phases):
            for log in range(logs):
                yield epoch, cycle, phase, log
