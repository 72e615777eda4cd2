"""The survey of a log: what of it can be believed, damaged or not.

A chunk whose CRC holds is believed wherever it stands. What no CRC of its own protects is believed up to the first
damage only, or throughout if the CRC over the data section holds.
"""

import os
from collections.abc import Callable
from io import SEEK_END
from pathlib import Path
from typing import BinaryIO

from recorders.errors import LogError
from recorders.files.regular_file import require_regular_file
from recorders.mcap_format.records import CRC, MAGIC, check_summary
from recorders.mcap_format.sections import whole_until
from recorders.reading.file_kind import no_log_text
from recorders.recovery.salvage import Damage, LogSurvey, opened
from recorders.recovery.summary_section import read_verified_summary
from recorders.recovery.walk import NOT_WHOLE, ResilientScan

CUT_OFF = "the log is cut off"
_DATA_CRC = "the CRC of the data section does not hold: something in it was changed that no other CRC covers"
_DOUBTED = "no CRC protects the messages from here on, and they are not believed"


def survey(path: str | os.PathLike[str], *, on_progress: Callable[[float], None] = lambda fraction: None) -> LogSurvey:
    """Find out what in a log can be believed.

    Parameters
    ----------
    path : path
        An MCAP file of any writer, finished or not, sound or not.
    on_progress : callable
        Called with the fraction of the file that was read.

    Raises
    ------
    LogError
        If there is no such file, it cannot be read, or it is not MCAP at all.
    """
    path = Path(path)
    require_regular_file(path)
    with opened(path) as file:
        size = os.fstat(file.fileno()).st_size
        begins, ends = _magics(file, size)
        summary = read_verified_summary(file)
        walk = ResilientScan(file, summary.start if summary else size, summary, lambda place: on_progress(place / size))
        walk.run()
        found = LogSurvey(path, size, finished=ends, summary=summary, spans=walk.spans, manifest=walk.manifest)
        found.damage = [] if begins else [Damage(0, "the log does not begin as one", 0)]
        found.damage += _all_damage(walk, found, file)
    _judge(walk, found)
    return found


def _magics(file: BinaryIO, size: int) -> tuple[bool, bool]:
    """Whether a file begins and ends as a log; raises LogError if it does neither."""
    begin = file.read(len(MAGIC))
    file.seek(-min(len(MAGIC), size), SEEK_END)
    ends = size > len(MAGIC) and file.read() == MAGIC
    if begin != MAGIC and not ends:
        raise LogError(no_log_text(begin))
    return begin == MAGIC, ends


def _all_damage(walk: ResilientScan, found: LogSurvey, file: BinaryIO) -> list[Damage]:
    """Return what is wrong in the data section, and behind it."""
    damage = walk.damage
    if not found.finished:
        if damage and damage[-1].reason == NOT_WHOLE and damage[-1].offset + damage[-1].skipped == found.size:
            *damage, last = damage
            return [*damage, last._replace(reason=CUT_OFF)]
        whole = found.size if walk.data_end is None else whole_until(file, found.size, walk.data_end.end)
        return [*damage, Damage(whole, CUT_OFF, 0)]
    if walk.data_end is not None and found.summary is None:
        file.seek(walk.data_end.end)
        try:
            check_summary(file, found.size)
        except LogError:
            return [*damage, Damage(walk.data_end.end, "the summary is damaged", 0)]
    return damage


def _judge(walk: ResilientScan, found: LogSurvey) -> None:
    """Decide what is believed of that which has no CRC of its own, and enter everything into the survey."""
    found.doubt_from = _doubt_from(walk, found)
    found.chunks, found.chunks_with_crc, found.declarations = walk.chunks, walk.chunks_with_crc, walk.declarations
    if found.summary:
        found.declarations.add(found.summary.declarations)
    bare = [each for each in walk.bare if each.offset < found.doubt_from]
    found.attachments = sorted([*walk.attachments, *bare], key=lambda each: each.offset)
    found.metadata_count = walk.metadata_count
    found.metadata = [offset for offset in walk.metadata if offset < found.doubt_from]
    if walk.header and found.doubt_from:
        found.profile, found.library = walk.header.profile, walk.header.library
    found.damage = sorted([*found.damage, *_doubted(walk, found)])


def _doubt_from(walk: ResilientScan, found: LogSurvey) -> int:
    """Return where belief in what has no CRC of its own ends [bytes]; sets whether the data section's CRC holds."""
    if walk.data_end and walk.crc is not None and any(walk.data_end.body[: CRC.size]):
        found.data_crc = CRC.unpack_from(walk.data_end.body)[0] == walk.crc
        if found.data_crc:
            return found.size
        found.damage.append(Damage(walk.data_end.offset, _DATA_CRC, 0))
        return 0
    doubts = [damage.offset for damage in found.damage if damage.offset]
    first = walk.first_protected  # messages without a CRC are out of place where others have one
    doubts += [span.start for span in walk.unprotected if first is not None and span.start > first]
    return min(doubts, default=found.size)


def _doubted(walk: ResilientScan, found: LogSurvey) -> list[Damage]:
    doubted = [span for span in walk.unprotected if span.start >= found.doubt_from]
    unknown = walk.unknown if found.damage else []  # or what damage made of others
    if not doubted:
        return unknown
    return [*unknown, Damage(doubted[0].start, _DOUBTED, sum(span.end - span.start for span in doubted))]
