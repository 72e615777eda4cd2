"""The physics tier of a golden case: teacher and simulation run again, and compared with the log."""

from collections import defaultdict, deque
from collections.abc import Iterable, Iterator
from dataclasses import replace
from itertools import chain, islice
from pathlib import Path

from recorders.cdr.codec import decode
from recorders.errors import MissingExtra
from recorders.messages.message_types import JointState, Message, PoseStamped
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import SAMPLE_JOINTS, commanded_tick, hands_among
from recorders.reading.reader import LogReader
from recorders.ticks.joiner import join_ticks
from replay.golden.case import Case, Tolerances
from replay.golden.finding import PHYSICS, Finding, error_text
from replay.golden.recipe import PHYSICS_TICKS, Runner


def check_physics(case: Case, runner: Runner) -> Finding | None:
    """Return the first message that teacher and simulation do not make as the logs have it.

    Where the runner knows no tolerance, the case's hold: of a robot whose sensors have a resolution it is exactly so.

    Raises
    ------
    MissingExtra
        If what simulates is not installed.
    """
    if not case.recipe.physics:
        return None
    findings = (_check_log(path, case.tolerances, runner) for path in case.recipe.logs)
    return next((finding for finding in findings if finding is not None), None)


def _check_log(path: Path, tolerances: Tolerances, runner: Runner) -> Finding | None:
    try:
        simulated = runner.simulate(path, ticks=PHYSICS_TICKS)
        if (tolerance := runner.physics_tolerance(path)) is not None:
            tolerances = replace(tolerances, joints=tolerance, hands_m=tolerance)
        return first_beyond(path, simulated, tolerances, note=runner.changed_robot(path))
    except MissingExtra:
        raise
    except Exception as error:
        return Finding(PHYSICS, "simulation", "one that comes to its end", error_text(error), {"log": path.name})


def first_beyond(
    path: Path,
    simulated: Iterable[tuple[str, Message]],
    tolerances: Tolerances,
    *,
    ticks: int = PHYSICS_TICKS,
    note: str = "",
) -> Finding | None:
    """Return the first message that is not as a log has it, within tolerances.

    Parameters
    ----------
    path : Path
        The log.
    simulated : iterable of (str, Message)
        Topic and message, in the order in which they were made; on each topic the log has the same.
    tolerances : Tolerances
        What positions of joints and hands may differ by; stamps and names are exact.
    ticks : int
        Of the log's first ticks, as many must have been made, if it has so many.
    note : str
        A remark for the finding.
    """
    logged = _Logged(path)
    for topic, message in simulated:
        record = logged.next(topic)
        if record is None:
            return Finding(PHYSICS, "message", "absent", "present", {"log": path.name, "topic": topic}, note)
        for field, expected, found, tolerance in _compared(decode(record.type, record.data), message, tolerances):
            if expected != found and not _close(expected, found, tolerance):
                place: dict[str, str | int] = {"log": path.name, "topic": topic, "sequence": record.sequence}
                place["stamp_ns"] = _stamp(message)
                return Finding(PHYSICS, field, repr(expected), repr(found), place, _with(note, tolerance))
    return _first_missing(path, logged, ticks, note)


def _first_missing(path: Path, logged: "_Logged", ticks: int, note: str) -> Finding | None:
    """Return the first message, up to the last tick due, that the simulation lacks."""
    log = LogReader(path)
    topics = commanded_tick(hands_among(log.topics))
    due = [tick.stamp_ns for tick in islice(join_ticks(log, topics=topics), ticks)]
    record = logged.first_left(up_to_ns=max(due, default=0))
    if record is None:
        return None
    place: dict[str, str | int] = {"log": path.name, "topic": record.topic, "sequence": record.sequence}
    return Finding(PHYSICS, "message", "present", "absent", place, note)


class _Logged:
    """The messages of a log, topic by topic, read as they are asked for."""

    def __init__(self, path: Path) -> None:
        log = LogReader(path)
        topics = [topic for topic in log.topics if topic == SAMPLE_JOINTS or hands_among([topic])]
        self._records = log.records(topics=topics)
        self._waiting: defaultdict[str, deque[RecordedMessage]] = defaultdict(deque)

    def next(self, topic: str) -> RecordedMessage | None:
        """Return the next message on a topic, None if there is no more."""
        while not self._waiting[topic]:
            record = next(self._records, None)
            if record is None:
                return None
            self._waiting[record.topic].append(record)
        return self._waiting[topic].popleft()

    def first_left(self, *, up_to_ns: int) -> RecordedMessage | None:
        """Return a message that was not asked for and is stamped no later, None if there is none: the rest is read."""
        left = chain.from_iterable((*self._waiting.values(), self._records))
        return next((record for record in left if _stamp(decode(record.type, record.data)) <= up_to_ns), None)


def _compared(
    logged: Message, simulated: Message, tolerances: Tolerances
) -> Iterator[tuple[str, object, object, float | None]]:
    """Yield field, both values and tolerance; None where a value is exact."""
    yield "type", logged.TYPE, simulated.TYPE, None
    yield "header.stamp", _stamp(logged), _stamp(simulated), None
    if isinstance(logged, JointState) and isinstance(simulated, JointState):
        yield "name", logged.name, simulated.name, None
        yield "len(position)", len(logged.position), len(simulated.position), None
        positions = zip(
            logged.name, logged.position.tolist(), simulated.position.tolist(), strict=False
        )  # or no positions
        for place, (name, expected, found) in enumerate(positions):
            yield f"position[{place}] ({name})", expected, found, tolerances.joints
    elif isinstance(logged, PoseStamped) and isinstance(simulated, PoseStamped):
        pairs = zip("xyz", logged.position.tolist(), simulated.position.tolist(), strict=True)
        for axis, expected, found in pairs:
            yield f"pose.position.{axis}", expected, found, tolerances.hands_m


def _stamp(message: Message) -> int:
    return int(getattr(message, "stamp_ns", 0))


def _close(expected: object, found: object, tolerance: float | None) -> bool:
    if tolerance is None or not isinstance(expected, float) or not isinstance(found, float):
        return False
    return abs(expected - found) <= tolerance


def _with(note: str, tolerance: float | None) -> str:
    parts = [f"tolerance {tolerance:g}" if tolerance is not None else "", note]
    return "; ".join(part for part in parts if part)
