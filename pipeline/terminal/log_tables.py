"""Tables of `info` and `recover`; a log may come from anyone, so its texts are escaped."""

import json
from collections.abc import Iterator, Mapping, Sequence
from datetime import UTC, datetime
from itertools import islice
from typing import Any

from pipeline.terminal.escaping import wrapped
from recorders.recovery.log_info import LogSummary
from recorders.recovery.recover import Recovery
from recorders.recovery.salvage import Damage
from recorders.recovery.topic_info import TopicSummary
from recorders.text.quantities import seconds_text
from recorders.text.wording import escape_control, names_text

_LONGEST = 100  # characters of a value of the manifest
_LONGEST_NAME = 300  # characters of a topic or a type
_DAMAGE_SHOWN = 20
_TOPICS_SHOWN = 500
_NS, _MS = 10**9, 10**6
_TIED = "\N{NO-BREAK SPACE}"  # between a number and its unit, until lines are broken
_LATENCY_NS = 3600 * _NS  # the most that --latency takes
_DATED_NS = 10**9 * _NS  # from the year 2001 on, times are of a clock that knows the date
_NOTABLE_NS = _NS  # how far stamps and log time may be apart without a word


def overview(summary: LogSummary) -> dict[str, str]:
    """Return the properties of the whole log, by name."""
    found = summary.survey
    compression = ", ".join(f"{count} {name or 'uncompressed'}" for name, count in found.chunks.items())
    lines = {
        "log": found.path.name,
        "size": f"{_bytes(found.size)}; chunks: {compression or 'none'}",
        "written by": f"{found.library or 'unknown'}; profile {found.profile or 'none'}",
        "state": _state(summary),
        "protection": _protection(summary),
        "content": _CONTENT[summary.content_holds] + _counts(summary),
        "time": _times(summary),
        "attachments": names_text(f"{each.name} ({_bytes(each.size)})" for each in found.attachments) or "none",
    }
    for session in summary.sessions.values():
        cycles = ", ".join(f"{count} {phase}" for phase, count in session.cycles.items())
        lines[f"run {session.run}"] = f"epochs {session.first_epoch} to {session.last_epoch}; markers: {cycles}"
    entries = found.manifest.items()
    manifest = {f"manifest: {name}": _value(value) for name, value in entries if value is not None}
    return {escape_control(name): escape_control(text) for name, text in (lines | manifest).items()}


def topic_lines(summary: LogSummary, width: int) -> Iterator[str]:
    """Yield the properties of each topic, in lines of `width`, with times from the first message of the log on."""
    yield "Topics"
    begin_ns = summary.times_ns[0] if summary.times_ns else 0
    for topic in islice(summary.topics.values(), _TOPICS_SHOWN):
        names = [_cut(topic.topic), _cut(topic.type or topic.encoding)]
        joined = "  ".join(names)
        for name in [joined] if len(joined) <= width else names:
            yield from wrapped(name, width)
        for line in wrapped("; ".join(_of_topic(topic, begin_ns)), width, indent="    "):
            yield line.replace(_TIED, " ")
    if len(summary.topics) > _TOPICS_SHOWN:
        yield from wrapped(f"and {len(summary.topics) - _TOPICS_SHOWN} topics more; --json lists them all", width)


def clock_lines(summary: LogSummary, width: int) -> Iterator[str]:
    """Yield the topics whose stamps are of another clock than those of most, and what to do, in lines of `width`."""
    for each in summary.clocks:
        topic, other = _cut(each.topic), _cut(each.other)
        together = f"those of {other}, recorded at the same time"
        side = "ahead of" if each.ahead_ns > 0 else "behind"
        apart = f"{_span(abs(each.ahead_ns))} {side}"
        if each.drift_ns is not None:
            pace = f"{'faster' if each.drift_ns > 0 else 'slower'} than that of {other}"
            text = (
                f"the clock of {topic} runs {pace}, by {_span(abs(each.drift_ns))} in all, and is {apart} it half-way; "
                "take the times of recording with --clock log"
            )
        else:
            near_ns = round(each.ahead_ns / _MS) * _MS
            latency = f"--latency {topic}={seconds_text(near_ns)} or " if abs(near_ns) <= _LATENCY_NS else ""
            text = (
                f"stamps of {topic} are {apart} {together}: its clock is off, or one of the two comes late; if it is "
                f"the clock, {latency}--clock log puts it right"
            )
        for line in wrapped(f"clocks: {text}", width):
            yield line.replace(_TIED, " ")


def damage_lines(damage: Sequence[Damage], width: int) -> Iterator[str]:
    """Yield the places where a log is damaged, the first few, in lines of `width`."""
    yield "Damage"
    for each in damage[:_DAMAGE_SHOWN]:
        text = f"byte {each.offset}: {each.reason}; {_bytes(each.skipped)} skipped"
        yield from wrapped(escape_control(text), width, indent="    ")
    if len(damage) > _DAMAGE_SHOWN:
        yield f"and {len(damage) - _DAMAGE_SHOWN} more"


def recovered(recovery: Recovery) -> dict[str, str]:
    """Return the result of a recovery, by name."""
    lines = {
        "recovered": _messages(recovery.saved.total()),
        "lost": _lost(recovery),
        "skipped": _bytes(recovery.skipped),
        "attachments": names_text(recovery.attachments) or "none",
        "complete": "yes" if recovery.complete else "no",
        "log": str(recovery.out),
    }
    if recovery.lost_attachments:
        lines["lost attachments"] = names_text(recovery.lost_attachments)
    if recovery.unprotected:
        lines["in doubt"] = f"{_messages(recovery.unprotected)} that no CRC protects"
    return {escape_control(name): escape_control(text) for name, text in lines.items()}


_CONTENT: Mapping[bool | None, str] = {
    True: "the messages are those that the manifest has the hash of",
    False: "the messages are NOT those that the manifest has the hash of",
    None: "the manifest has no hash of the messages",
}

_TOTALS_NAMED = 3


def _counts(summary: LogSummary) -> str:
    wrong = summary.wrong_totals
    more = f"; and {len(wrong) - _TOTALS_NAMED} more" if len(wrong) > _TOTALS_NAMED else ""
    return (
        f", and NOT as many as the summary states: {'; '.join(map(_cut, wrong[:_TOTALS_NAMED]))}{more}" if wrong else ""
    )


def _state(summary: LogSummary) -> str:
    if summary.cut_off_at is not None:
        state = f"cut off at byte {summary.cut_off_at}"
    else:
        state = "finished" if summary.survey.finished else "not finished"
    complete = summary.survey.manifest.get("complete")
    whole = {True: ", complete", False: ", not complete"}.get(complete, "") if isinstance(complete, bool) else ""
    return state + whole + ("" if summary.sound else "; damaged")


def _protection(summary: LogSummary) -> str:
    if summary.times_ns is None:
        return "no messages"
    if summary.protected:
        return "CRCs protect every message"
    return f"no CRC protects {_messages(summary.unprotected)}: damage to them would pass unseen"


def _times(summary: LogSummary) -> str:
    if summary.times_ns is None:
        return "no messages"
    first_ns, last_ns = summary.times_ns
    span = f"{seconds_text(first_ns)} s to {seconds_text(last_ns)} s, {(last_ns - first_ns) / _NS:.3f} s in all"
    return span if first_ns < _DATED_NS else f"{_date(first_ns)} to {_date(last_ns)}: {span}"


def _date(time_ns: int) -> str:
    """Return a time as date and time of day, to the second; in seconds where no date can be."""
    try:
        return datetime.fromtimestamp(time_ns // _NS, UTC).strftime("%Y-%m-%d %H:%M:%S UTC")
    except (OverflowError, ValueError, OSError):
        return f"{seconds_text(time_ns)} s"


def _of_topic(topic: TopicSummary, begin_ns: int) -> Iterator[str]:
    """Yield the properties of a topic, a phrase each."""
    rate = _rate(topic.rate_hz) + (f" (stamps {_rate(topic.stamp_rate_hz)})" if topic.stamp_rate_hz else "")
    yield f"{_messages(topic.count)}, {rate}"
    yield f"{_moment(topic.first_ns - begin_ns)} to {_moment(topic.last_ns - begin_ns)}"
    if topic.longest_gap_ns is not None:
        after_ns = topic.log_times.longest_after_ns - begin_ns
        yield f"longest gap {_span(topic.longest_gap_ns)} after {_moment(after_ns)}"
    if topic.log_times.jitter_ns is not None:
        yield f"jitter {_span(topic.log_times.jitter_ns)}"
    yield _missing(topic)
    if topic.log_times.falls:
        yield f"log time falls {_often(topic.log_times.falls)} in the order of the file"
    if topic.numbers.restarts:
        yield f"numbers begin anew {_often(topic.numbers.restarts)}"
    if topic.ahead_ns is not None:
        yield from _ahead(*topic.ahead_ns)


def _missing(topic: TopicSummary) -> str:
    numbers = topic.numbers
    places = ", ".join(f"{before}..{after}" for before, after in numbers.gaps)
    by_number = f"{numbers.missing} missing by number" + (
        f" ({places}{', …' if numbers.more_gaps else ''})" if places else ""
    )
    text = by_number if topic.numbered or numbers.missing else "no numbers of its own"
    if topic.dropped is None or topic.dropped == numbers.missing:
        return text
    return f"{text}, about {topic.dropped} missing by time"


def _ahead(least_ns: int, most_ns: int) -> Iterator[str]:
    """Yield how stamps lie to log time where that is worth a word."""
    if least_ns > _NOTABLE_NS:
        yield f"stamps are {_span(least_ns)} or more ahead of log time"
    elif most_ns > _NOTABLE_NS:
        yield f"stamps are up to {_span(most_ns)} ahead of log time"
    if most_ns < -_NOTABLE_NS:
        yield f"stamps are {_span(-most_ns)} or more behind log time"
    elif least_ns < -_NOTABLE_NS:
        yield f"stamps are up to {_span(-least_ns)} behind log time"


def _lost(recovery: Recovery) -> str:
    if recovery.lost is None:
        return "unknown: the log does not state it"
    by_topic = names_text(f"{topic} {count}" for topic, count in recovery.lost.items())
    count = f"{'' if recovery.exact else 'at least '}{_messages(recovery.lost.total())}"
    return f"{count} ({by_topic})" if by_topic else count


def _messages(count: int) -> str:
    return f"{count} message" if count == 1 else f"{count} messages"


def _value(value: Any) -> str:
    text = value if isinstance(value, str) else json.dumps(value)
    return text if len(text) <= _LONGEST else text[:_LONGEST] + "…"


def _rate(rate_hz: float | None) -> str:
    return "no rate" if rate_hz is None else f"{rate_hz:.2f}{_TIED}Hz"


def _moment(time_ns: int) -> str:
    """Return a time since the beginning of the log."""
    return f"{time_ns / _NS:.3f}{_TIED}s"


def _span(time_ns: int) -> str:
    """Return a length of time in the unit that suits it."""
    for unit_ns, unit in ((_NS, "s"), (_NS // 1000, "ms"), (1000, "us")):
        if time_ns >= unit_ns:
            return f"{time_ns / unit_ns:.{3 if unit == 's' else 1}f}{_TIED}{unit}"
    return f"{time_ns}{_TIED}ns"


def _often(count: int) -> str:
    return "once" if count == 1 else f"{count}{_TIED}times"


def _cut(name: str) -> str:
    shown = escape_control(name[:_LONGEST_NAME])
    return shown if len(name) <= _LONGEST_NAME else f"{shown}…"


def _bytes(count: int) -> str:
    for size, unit in ((10**9, "GB"), (10**6, "MB"), (10**3, "kB")):
        if count >= size:
            return f"{count / size:.1f} {unit}"
    return f"{count} B"
