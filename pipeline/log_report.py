"""What `info` and `recover` show on a terminal; a log may come from anyone, so none of it gets there raw."""

import json
from collections.abc import Iterable, Mapping
from typing import Any

from rich.table import Table
from rich.text import Text

from pipeline.printable import printable
from recorders.quantities import seconds_text
from recorders.recover import Recovery
from recorders.salvage import Damage
from recorders.summary import LogSummary, TopicSummary

_LONGEST = 100  # characters of a value of the manifest
_DAMAGE_SHOWN = 20
_NS = 1e9


def overview(summary: LogSummary) -> dict[str, str]:
    """Return what there is to say of the whole log, by name."""
    found = summary.survey
    compression = ", ".join(f"{count} {name or 'uncompressed'}" for name, count in found.chunks.items())
    lines = {
        "log": found.path.name,
        "size": f"{_bytes(found.size)}; chunks: {compression or 'none'}",
        "written by": f"{found.library or 'unknown'}; profile {found.profile or 'none'}",
        "state": _state(summary),
        "protection": "CRCs protect every message" if summary.protected else _unprotected(summary),
        "content": _CONTENT[summary.content_holds] + _counts(summary),
        "time": _times(summary),
        "attachments": ", ".join(f"{each.name} ({_bytes(each.size)})" for each in found.attachments) or "none",
    }
    for session in summary.sessions.values():
        cycles = ", ".join(f"{count} {phase}" for phase, count in session.cycles.items())
        lines[f"run {session.run}"] = f"epochs {session.first_epoch} to {session.last_epoch}; markers: {cycles}"
    said = found.manifest.items()
    manifest = {f"manifest: {name}": _value(value) for name, value in said if value is not None}
    return {printable(name): printable(text) for name, text in (lines | manifest).items()}


def topics_table(summary: LogSummary) -> Table:
    """Return a table of what is on each topic, with times from the first message of the log on."""
    table = Table(title="Topics", title_justify="left")
    for name in ("topic", "type"):
        table.add_column(name, overflow="fold")
    for name in ("messages", "Hz (log)", "Hz (stamp)", "from [s]", "to [s]", "missing"):
        table.add_column(name, justify="right")
    begin_ns = summary.times_ns[0] if summary.times_ns else 0
    for topic in summary.topics.values():
        cells = (
            topic.topic,
            topic.type or topic.encoding,
            str(topic.count),
            _rate(topic.rate_hz),
            _rate(topic.stamp_rate_hz),
            f"{(topic.first_ns - begin_ns) / _NS:.3f}",
            f"{(topic.last_ns - begin_ns) / _NS:.3f}",
            _missing(topic),
        )
        table.add_row(*(Text(printable(cell)) for cell in cells))
    return table


def damage_table(damage: Iterable[Damage]) -> Table:
    """Return a table of the places where a log is damaged, the first few."""
    table = Table(title="Damage", title_justify="left")
    table.add_column("at byte", justify="right")
    table.add_column("skipped", justify="right")
    table.add_column("what")
    listed = list(damage)
    for each in listed[:_DAMAGE_SHOWN]:
        table.add_row(str(each.offset), _bytes(each.skipped), Text(printable(each.reason)))
    if len(listed) > _DAMAGE_SHOWN:
        table.add_row("…", "", f"and {len(listed) - _DAMAGE_SHOWN} more")
    return table


def recovered(recovery: Recovery) -> dict[str, str]:
    """Return what became of a damaged log, by name."""
    lines = {
        "kept": f"{recovery.kept.total()} messages",
        "lost": _lost(recovery),
        "skipped": _bytes(recovery.skipped),
        "attachments": ", ".join(recovery.attachments) or "none",
        "complete": "yes" if recovery.complete else "no",
        "log": str(recovery.out),
    }
    if recovery.lost_attachments:
        lines["lost attachments"] = ", ".join(recovery.lost_attachments)
    if recovery.unprotected:
        lines["in doubt"] = f"{recovery.unprotected} messages that no CRC protects"
    return {printable(name): printable(text) for name, text in lines.items()}


_CONTENT: Mapping[bool | None, str] = {
    True: "the messages are those that the manifest has the hash of",
    False: "the messages are NOT those that the manifest has the hash of",
    None: "the manifest has no hash of the messages",
}

_TOTALS_NAMED = 3


def _counts(summary: LogSummary) -> str:
    wrong = summary.wrong_totals
    more = f"; and {len(wrong) - _TOTALS_NAMED} more" if len(wrong) > _TOTALS_NAMED else ""
    return f", and NOT as many as the summary says: {'; '.join(wrong[:_TOTALS_NAMED])}{more}" if wrong else ""


def _state(summary: LogSummary) -> str:
    if summary.cut_off_at is not None:
        state = f"cut off at byte {summary.cut_off_at}"
    else:
        state = "finished" if summary.survey.finished else "not finished"
    complete = summary.survey.manifest.get("complete")
    said = {True: ", complete", False: ", not complete"}.get(complete, "") if isinstance(complete, bool) else ""
    return state + said + ("" if summary.sound else "; damaged")


def _unprotected(summary: LogSummary) -> str:
    return f"no CRC protects {summary.unprotected} messages: damage to them would pass unseen"


def _times(summary: LogSummary) -> str:
    if summary.times_ns is None:
        return "no messages"
    first_ns, last_ns = summary.times_ns
    return f"{seconds_text(first_ns)} s to {seconds_text(last_ns)} s, {(last_ns - first_ns) / _NS:.3f} s"


def _missing(topic: TopicSummary) -> str:
    places = ", ".join(f"{before}..{after}" for before, after in topic.gaps)
    more = ", …" if topic.more_gaps else ""
    return f"{topic.missing} ({places}{more})" if topic.gaps else "0"


def _lost(recovery: Recovery) -> str:
    if recovery.lost is None:
        return "unknown: nothing in the log tells"
    by_topic = ", ".join(f"{topic} {count}" for topic, count in recovery.lost.items())
    count = f"{'' if recovery.exact else 'at least '}{recovery.lost.total()} messages"
    return f"{count} ({by_topic})" if by_topic else count


def _value(value: Any) -> str:
    text = value if isinstance(value, str) else json.dumps(value)
    return text if len(text) <= _LONGEST else text[:_LONGEST] + "…"


def _rate(rate_hz: float | None) -> str:
    return "-" if rate_hz is None else f"{rate_hz:.2f}"


def _bytes(count: int) -> str:
    for size, unit in ((10**9, "GB"), (10**6, "MB"), (10**3, "kB")):
        if count >= size:
            return f"{count / size:.1f} {unit}"
    return f"{count} B"
