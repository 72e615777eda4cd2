"""Recovery: a sound log from a damaged or cut-off one, and an account of what was saved and what was lost."""

import os
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

from recorders.errors import CheckFailed, LogError
from recorders.files import disk
from recorders.mcap_format.channels import DeclaredChannel
from recorders.mcap_format.lengths import LARGE
from recorders.mcap_format.manifest import FORMAT_VERSION, METADATA_NAME, ContentHash, stated_counts, to_metadata
from recorders.recovery.salvage import Damage, LogSurvey, Salvaged
from recorders.recovery.survey import survey
from recorders.recovery.tally import Tally
from recorders.writing.attachment_copy import copy_attachment
from recorders.writing.mcap_writer import McapWriter
from recorders.writing.part_file import PartFile, check_place, part_of

_OUTCOME = ("complete", "messages", "counts", "content_sha256")  # entries of the manifest at the end beside
_CHUNK_SIZE = 2**16  # bytes: the next damage costs one chunk
_MOST_CHANNELS = 2**16 - 1
_MOST_NOTED = 100  # places of damage that the manifest names


@dataclass(frozen=True)
class Recovery:
    """The result of recovering a damaged log.

    Attributes
    ----------
    source, out : Path
        The damaged log and the sound one.
    saved : Counter
        Number of messages saved, by topic.
    lost : Counter or None
        Number of messages lost, by topic; None if unknown.
    exact : bool
        Whether these are all that were lost; otherwise they are those whose numbers are missing at the damage, and
        there may be more.
    unprotected : int
        How many of those saved stood before the first damage, in no chunk with a CRC: they may be wrong.
    undeclared : int
        How many of those lost are there, on channels whose declaration is lost.
    attachments, lost_attachments : tuple of str
        Names of the attachments saved, and of those lost as far as the log's summary states.
    damage : tuple of Damage
        Where the log was damaged.
    complete : bool
        Whether the recording had been finished and nothing is lost.
    """

    source: Path
    out: Path
    saved: Counter[str]
    lost: Counter[str] | None
    exact: bool
    unprotected: int
    undeclared: int
    attachments: tuple[str, ...]
    lost_attachments: tuple[str, ...]
    damage: tuple[Damage, ...]
    complete: bool

    @property
    def skipped(self) -> int:
        """Size of what could not be read [bytes]."""
        return sum(damage.skipped for damage in self.damage)

    def to_dict(self) -> dict[str, Any]:
        """Return the same as JSON values."""
        return {
            "from": str(self.source),
            "out": str(self.out),
            "complete": self.complete,
            "kept": self.saved.total(),
            "kept_by_topic": dict(self.saved),
            "lost": None if self.lost is None else self.lost.total(),
            "lost_by_topic": None if self.lost is None else dict(self.lost),
            "lost_exact": self.exact,
            "unprotected": self.unprotected,
            "undeclared": self.undeclared,
            "skipped_bytes": self.skipped,
            "attachments": list(self.attachments),
            "lost_attachments": list(self.lost_attachments),
            "damage": [damage._asdict() for damage in self.damage],
        }


def recover(
    source: str | os.PathLike[str],
    out: str | os.PathLike[str],
    *,
    overwrite: bool = False,
    on_progress: Callable[[float], None] = lambda fraction: None,
) -> Recovery:
    """Write what can be believed of a damaged log to another one.

    Messages keep their bytes, numbers, times, channels and schemas. The source is only read. The new log has its name
    once it is whole, and is not there at all if this fails or is interrupted.

    Parameters
    ----------
    source : path
        An MCAP file of any writer.
    out : path
        The log to write.
    overwrite : bool
        Whether a file of that name may be replaced.
    on_progress : callable
        Called with the fraction done.

    Raises
    ------
    LogError
        If the source is not MCAP at all or cannot be read, or the new log exists, is the source, or cannot be written.
    CheckFailed
        If there is nothing in the source that can be believed.
    """
    source, out = Path(source), Path(out)
    _refuse_source(out, source)
    check_place(out, overwrite=overwrite)
    found = survey(source, on_progress=lambda fraction: on_progress(fraction / 2))
    with _new_file(out, overwrite=overwrite) as file:
        return _Copy(found, file).run(out, lambda fraction: on_progress((1 + fraction) / 2))


class _Copy:
    """Copies what a survey found into a new file."""

    def __init__(self, found: LogSurvey, file: BinaryIO) -> None:
        self._found = found
        self._content = ContentHash()
        self._tally = Tally()
        self._channels: dict[DeclaredChannel, int] = {}
        self._schemas: dict[tuple[str, str, bytes], int] = {}
        self._log = McapWriter(file, profile=self._profile(), chunk_size=_CHUNK_SIZE)

    def run(self, out: Path, on_progress: Callable[[float], None]) -> Recovery:
        """Copy attachments, metadata and messages, then write the outcome to the manifest."""
        found = self._found
        if found.manifest:
            unfinished = {name: value for name, value in found.manifest.items() if name not in _OUTCOME}
            self._log.add_metadata(METADATA_NAME, to_metadata({**unfinished, "complete": False}))
        for offset in found.metadata:
            metadata = found.metadata_at(offset)
            self._log.add_metadata(metadata.name, metadata.metadata)
        for entry in found.attachments:
            with found.attachment(entry) as record:
                failure = copy_attachment(record, self._log)
            if failure:
                raise failure
        for message in found.messages(on_progress=on_progress):
            self._add(message)
            del message  # a large one would take memory beside the next
        recovery = self._account(out)
        self._log.add_metadata(METADATA_NAME, to_metadata(self._manifest(recovery)))
        self._log.finish()
        return recovery

    def _profile(self) -> str:
        """Return the profile, that of our logs if it is lost and this may be one."""
        if self._found.profile is not None:
            return self._found.profile
        channels = self._found.declarations.channels.values()
        return "ros2" if any(channel.encoding == "cdr" for channel in channels) else ""

    def _add(self, message: Salvaged) -> None:
        self._tally.add(message)
        channel = message.channel
        if channel is None:
            return
        number = self._channels.get(channel) or self._declare(channel)
        numbers = message.sequence, message.log_time_ns
        if len(message.data) + (message.rest.size if message.rest else 0) <= LARGE:
            self._log.add_message((number, *numbers, message.publish_time_ns, message.data))
        else:
            self._log.add_message_in_pieces(number, *numbers, message.publish_time_ns, message.data, message.rest)
        self._content.add(channel.topic, *numbers, message.data, message.rest)

    def _declare(self, channel: DeclaredChannel) -> int:
        if len(self._channels) == _MOST_CHANNELS:
            raise LogError(f"{self._found.path}: expected at most {_MOST_CHANNELS} channels, found more")
        schema = 0  # MCAP's number for no schema
        if channel.schema is not None:
            schema = self._schemas.get(channel.schema) or self._log.register_schema(*channel.schema)
            self._schemas[channel.schema] = schema
        number: int = self._log.register_channel(channel.topic, channel.encoding, schema, dict(channel.metadata))
        self._channels[channel] = number
        return number

    def _account(self, out: Path) -> Recovery:
        found, tally = self._found, self._tally
        if found.damage and not (tally.saved or found.attachments or found.manifest):
            raise CheckFailed(
                f"{found.path}: nothing in it can be believed: {found.damage[0].reason}; "
                f"expected messages that are whole, found none in {found.size} bytes, nor attachments, nor a manifest"
            )
        lost, exact = tally.lost(found)
        expected = Counter(found.summary.attachments if found.summary else ())
        expected.subtract(entry.name for entry in found.attachments)
        return Recovery(
            source=found.path,
            out=out,
            saved=tally.saved,
            lost=lost,
            exact=exact,
            unprotected=0 if found.data_crc else tally.unprotected,
            undeclared=tally.undeclared,
            attachments=tuple(entry.name for entry in found.attachments),
            lost_attachments=tuple((+expected).elements()),
            damage=tuple(found.damage),
            complete=found.finished and exact and not (lost or tally.undeclared or +expected) and self._is_all(),
        )

    def _is_all(self) -> bool:
        """Whether the log's summary and manifest, if it has them, state that this is all of a finished recording."""
        found, manifest = self._found, self._found.manifest
        stated = found.summary.statistics if found.summary else None
        if stated is not None and (
            stated.metadata_count > found.metadata_count or stated.attachment_count > len(found.attachments)
        ):
            return False
        if not manifest:
            return True
        return manifest.get("complete") is True and manifest.get("content_sha256") == self._content.hexdigest()

    def _manifest(self, recovery: Recovery) -> dict[str, Any]:
        note: dict[str, Any] = {
            "from": recovery.source.name,
            "kept": recovery.saved.total(),
            "lost": None if recovery.lost is None else recovery.lost.total(),
            "damage": [{"offset": each.offset, "reason": each.reason} for each in recovery.damage[:_MOST_NOTED]],
        }
        earlier = self._found.manifest.get("recovered")
        return {
            **self._found.manifest,
            "format_version": FORMAT_VERSION,
            "complete": recovery.complete,
            "messages": recovery.saved.total(),
            "counts": stated_counts(recovery.saved),
            "content_sha256": self._content.hexdigest(),
            "recovered": note if earlier is None else {**note, "earlier": earlier},
        }


@contextmanager
def _new_file(out: Path, *, overwrite: bool) -> Iterator[BinaryIO]:
    """Open a file that gets its name when the block ends, and goes away if it fails."""
    file = _claimed(out, overwrite=overwrite)
    try:
        yield file.stream
        file.publish()
    except OSError as error:
        raise file.error(error) from error
    finally:
        file.close(keep=False)


def _refuse_source(out: Path, source: Path) -> None:
    part = Path(f"{out}.part")
    for path, used in ((out, ""), (part, f"until it is whole it is called {part.name}, and ")):
        if path.exists() and source.exists() and path.samefile(source):
            raise LogError(
                f"cannot write {out}: {used}{path} is the damaged log, which stays as it is; choose another name"
            )


def _claimed(out: Path, *, overwrite: bool) -> PartFile:
    """Make the file; an interruption meanwhile leaves no empty one."""
    part = part_of(out)
    was_there = part.exists()
    try:
        return PartFile(out, overwrite=overwrite)
    except LogError:
        raise
    except BaseException:
        if not was_there:
            with suppress(OSError):
                disk.unlink(part)
        raise
