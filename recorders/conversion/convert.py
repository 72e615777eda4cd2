"""Conversion of recordings to MCAP: bytes and encodings stay, and the same input gives the same file."""

import hashlib
import json
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path
from typing import Any

from recorders.containers.reader import Opened
from recorders.conversion.attachments import add_attachments, copy_attachments, copy_metadata
from recorders.conversion.config import COMPRESSIONS, ConvertConfig
from recorders.conversion.sources import Sources
from recorders.errors import LogError, TakenError
from recorders.files import disk
from recorders.mcap_format.manifest import FORMAT_VERSION, environment
from recorders.messages.record import RecordedMessage
from recorders.reading.parts import PART, Parts, part_path, parts_in
from recorders.reading.raw_messages import FOREVER_NS
from recorders.writing.bulk_writer import BulkWriter
from recorders.writing.part_file import PartFile, check_place

_NO_LIMIT = 2**64


@dataclass(frozen=True)
class Conversion:
    """The result of a conversion.

    Attributes
    ----------
    paths : list of Path
        The files written.
    counts : Counter
        Number of messages by topic.
    sources : list of dict
        Name of each recording, and name and SHA-256 of its files.
    """

    paths: list[Path] = field(default_factory=list)
    counts: Counter[str] = field(default_factory=Counter)
    sources: list[dict[str, Any]] = field(default_factory=list)

    def to_dict(self) -> dict[str, Any]:
        """Return the same as JSON values."""
        return {
            "out": [str(path) for path in self.paths],
            "messages": self.counts.total(),
            "topics": dict(self.counts),
            "sources": self.sources,
        }


def convert(
    logs: Sequence[Opened],
    out: Path,
    config: ConvertConfig | None = None,
    *,
    overwrite: bool = False,
    on_progress: Callable[[float], None] = lambda fraction: None,
) -> Conversion:
    """Write recordings in any containers to one MCAP file, or to several that are one session.

    Messages keep bytes, encodings, numbers and times; several recordings are merged by log time. Attachments and
    metadata of MCAP come along.

    Parameters
    ----------
    logs : sequence of Path, Parts or Reader
        The recordings, or what reads one in its own way, such as ticks of it.
    out : Path
        Where they go; with a split `NAME_000.mcap` and so on.
    config : ConvertConfig, optional
        What is written, and how.
    overwrite : bool
        Whether files of these names may be replaced.
    on_progress : callable
        Called with the fraction done.

    Raises
    ------
    LogError
        If a recording cannot be read, nothing is left of them, or the file cannot be written.
    ConfigError
        If the settings do not go with the recordings.
    """
    config = config or ConvertConfig()
    _check_out(out, logs, splits=config.splits, overwrite=overwrite)
    sources = Sources(logs, config)
    digests = sources.digests()
    manifest = sources.manifest()
    earlier = {"earlier": manifest["converted"]} if "converted" in manifest else {}
    manifest["converted"] = {"sources": digests, **config.to_dict(), **earlier}
    total = sources.count()
    writing = _Writing(
        sources, out, config, manifest, overwrite, lambda count: on_progress(count / (total or _NO_LIMIT))
    )
    result = Conversion(sources=digests)
    writing.write_all(result)
    return result


@dataclass
class _Writing:
    """Writes a stream to one file after another."""

    sources: Sources
    out: Path
    config: ConvertConfig
    manifest: Mapping[str, Any]
    overwrite: bool
    on_count: Callable[[int], None]

    def write_all(self, result: Conversion) -> None:
        """Write every file; none is left if one fails."""
        stale = set(parts_in(self.out.parent, self.out.stem)) if self.config.splits and self.overwrite else set()
        with closing(self.sources.records()) as records:
            self._write_files(records, result)
        self._remove(sorted(stale.difference(result.paths)))

    def _write_files(self, records: Iterator[RecordedMessage], result: Conversion) -> None:
        following = next(records, None)
        if following is None:
            of_slice = f" in the slice from {self.config.span}" if self.config.sliced else ""
            raise LogError(f"expected messages{of_slice} in {self.sources.names}, found none")
        try:
            while following is not None:
                following = self._write_file(chain([following], records), following.log_time_ns, result)
        except BaseException:
            for path in result.paths:
                with suppress(OSError):
                    disk.unlink(path)
            raise

    def _remove(self, stale: Sequence[Path]) -> None:
        """Remove parts of what was replaced, that would be taken for parts of this."""
        try:
            for path in stale:
                with suppress(FileNotFoundError):  # a `.part` that was in the way was set aside
                    disk.unlink(path)
            if stale:
                disk.sync_folder(self.out.parent)
        except OSError as error:
            raise LogError(
                f"{self.out}: its parts are whole, but those of before are not all gone: {error.strerror or error}"
            ) from error

    def _write_file(
        self, records: Iterator[RecordedMessage], first_ns: int, result: Conversion
    ) -> RecordedMessage | None:
        config, number = self.config, len(result.paths)
        path = part_path(self.out, number) if config.splits else self.out
        before = result.counts.total()
        with _new_file(path, overwrite=self.overwrite) as file:
            writer = BulkWriter(
                file.stream,
                self.sources.channels,
                profile=self.sources.profile,
                compression=COMPRESSIONS[config.compression],
                on_chunk=lambda count: self.on_count(before + count),
            )
            if not number:
                self._begin(writer)
            following = writer.write(
                records,
                end_ns=FOREVER_NS if config.split_ns is None else first_ns + config.split_ns,
                most_bytes=config.split_bytes or _NO_LIMIT,
            )
            writer.finish(self._manifest(number, more=following is not None))
        result.paths.append(path)
        result.counts.update(writer.counts)
        return following

    def _begin(self, writer: BulkWriter) -> None:
        """Write what recordings in MCAP hold beside messages."""
        parts = self.sources.mcap_parts()
        copy_metadata(parts, writer.log)
        copy_attachments(parts, writer.log)
        add_attachments(self.sources.others(), writer.log)

    def _manifest(self, number: int, *, more: bool) -> dict[str, Any]:
        entries = {
            **self.manifest,
            "format_version": FORMAT_VERSION,
            "environment": environment(),
            "complete": True,
        }
        if self.config.splits:
            session = hashlib.sha256(json.dumps(self.manifest["converted"], sort_keys=True).encode()).hexdigest()[:32]
            entries[PART] = {"session": session, "number": number, "more": more}
        return entries


def _check_out(out: Path, logs: Sequence[Opened], *, splits: bool, overwrite: bool) -> None:
    """Refuse names that are taken, or that are one of the recordings."""
    taken = parts_in(out.parent, out.stem) if splits else []
    if taken and not overwrite:
        raise TakenError(f"{taken[0]} exists: choose another name, or --overwrite")
    named = [log if isinstance(log, Path | Parts) else log.path for log in logs]
    read = {path.resolve() for log in named for path in (log.paths if isinstance(log, Parts) else (log,))}
    for path in taken or [out]:
        if path.resolve() in read:
            raise LogError(
                f"cannot write {path}: it is one of the recordings, which stay as they are; choose another name"
            )
        if not (taken and path.suffix == ".part"):  # what a crash left may hold anything
            check_place(path, overwrite=overwrite)


@contextmanager
def _new_file(path: Path, *, overwrite: bool) -> Iterator[PartFile]:
    """Open a file that gets its name when the block ends, and goes away if it fails."""
    file = PartFile(path, overwrite=overwrite)
    try:
        yield file
        file.publish()
    except OSError as error:
        raise file.error(error) from error
    finally:
        file.close(keep=False)
