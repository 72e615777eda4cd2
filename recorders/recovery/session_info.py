"""Summary of a session in parts: its parts one by one, each checked, and together as if they were one log."""

from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path

from recorders.containers.opening import container_of, is_foreign_container, open_as_it_is
from recorders.reading.parts import PART, Log, Parts
from recorders.recovery.log_info import LogSummary, summarise
from recorders.recovery.salvage import Damage, LogSurvey, Salvaged
from recorders.recovery.survey import survey
from recorders.writing.writer import RESERVED

_REPORTED = 4096  # messages between two reports of progress


def summarise_log(log: Log, *, on_progress: Callable[[float], None] = lambda fraction: None) -> LogSummary:
    """Read a log, or all parts of a session, from end to end and return what is in it: see `summarise`.

    Raises
    ------
    LogError
        If one of the files is not there, cannot be read, or is not MCAP at all.
    """
    if not isinstance(log, Parts):
        foreign = is_foreign_container(log)
        return summarise_container(log, on_progress) if foreign else summarise(log, on_progress=on_progress)
    whole = LogSummary(LogSurvey(log.paths[0].with_name(log.name), 0))
    parts = []
    for number, path in enumerate(log.paths):
        part = LogSummary(survey(path))
        for message in part.survey.messages():
            part.add(message)
            whole.add(message)
            del message  # a large one would take memory beside the next
        part.finish()
        parts.append(part)
        on_progress((number + 1) / len(log.paths))
    whole.judge_numbers()
    whole.survey = _joined(whole.survey, [part.survey for part in parts])
    whole.content_holds = _all([part.content_holds for part in parts])
    whole.counts_hold = _all([part.counts_hold for part in parts])
    whole.wrong_totals = [f"{part.survey.path.name}: {total}" for part in parts for total in part.wrong_totals]
    return whole


def summarise_container(log: Path, on_progress: Callable[[float], None] = lambda fraction: None) -> LogSummary:
    """Read a recording in another container than MCAP from end to end and return what is in it: see `summarise`.

    Raises
    ------
    LogError
        If it cannot be read, or is damaged.
    """
    reader = open_as_it_is(log)
    channels = {channel.topic: channel for channel in reversed(reader.channels)}
    files = (path for path in (log.rglob("*") if log.is_dir() else (log,)) if path.is_file())
    summary = LogSummary(LogSurvey(log, sum(path.stat().st_size for path in files), finished=True))
    summary.survey.library = container_of(log).name
    total = sum(reader.counts.values()) or 1
    for number, (topic, _, data, sequence, time_ns) in enumerate(reader):
        summary.add(Salvaged(0, 0, False, channels[topic], sequence, time_ns, time_ns, data))
        if not number % _REPORTED:
            on_progress(number / total)
    summary.finish()
    return summary


def _joined(whole: LogSurvey, parts: Sequence[LogSurvey]) -> LogSurvey:
    """Fill in what the parts come to: sums, all that is there once, and damage with the name of its part."""
    whole.size = sum(part.size for part in parts)
    whole.profile, whole.library = parts[0].profile, parts[0].library
    whole.finished = all(part.finished for part in parts)
    whole.data_crc = all(part.data_crc for part in parts)
    whole.chunks = sum((part.chunks for part in parts), Counter[str]())
    whole.chunks_with_crc = sum(part.chunks_with_crc for part in parts)
    whole.attachments = list({each.name: each for part in parts for each in part.attachments}.values())
    whole.damage = [
        Damage(damage.offset, f"{part.path.name}: {damage.reason}", damage.skipped)
        for part in parts
        for damage in part.damage
    ]
    entries = {name: value for part in parts for name, value in part.manifest.items()}
    whole.manifest = {name: value for name, value in entries.items() if name not in (*RESERVED, PART)}
    if entries:
        whole.manifest["complete"] = all(part.manifest.get("complete") is True for part in parts)
    return whole


def _all(answers: Sequence[bool | None]) -> bool | None:
    """Whether something holds of every part; None if it is unknown of one, and false of no other."""
    if False in answers:
        return False
    return None if None in answers else True
