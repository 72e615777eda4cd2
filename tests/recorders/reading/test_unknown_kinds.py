"""Records of kinds that nobody knows, MCAP's of later or other programs' own, are passed over wherever they stand."""

import struct
import zlib
from typing import Any

import pytest
from every_record import packed
from mcap.records import Channel, Chunk, DataEnd, Footer, Header, Message

from recorders.errors import LogError
from recorders.mcap_format.records import MAGIC
from recorders.reading.reader import LogReader
from recorders.recovery.log_info import summarise
from recorders.recovery.recover import recover

CHANNEL = Channel(1, "/x", "x", {}, 0)
MESSAGES = [packed(Message(1, 10 * k, b"data", 0, k)) for k in range(6)]
KINDS = [0x10, 0x42, 0x7F, 0x80, 0xFF]


def unknown(kind, size):
    return struct.pack("<BQ", kind, size) + bytes(size)


def write(path, kind):
    """Write a log with such records in a chunk, beside it, and in the summary."""
    data = unknown(kind, 0) + packed(CHANNEL)
    data += b"".join(message + unknown(kind, 7) for message in MESSAGES[:3])
    chunk = packed(Chunk("", data, 20, 0, zlib.crc32(data), len(data)))
    beside = b"".join(unknown(kind, 300) + message for message in MESSAGES[3:])
    raw = MAGIC + packed(Header("", "other")) + unknown(kind, 1) + chunk + beside
    raw += packed(DataEnd(zlib.crc32(raw)))
    summary = packed(CHANNEL) + unknown(kind, 5)
    head = packed(Footer(len(raw), 0, 0))[:-4]
    path.write_bytes(raw + summary + head + struct.pack("<I", zlib.crc32(summary + head)) + MAGIC)


@pytest.mark.parametrize("kind", KINDS, ids=hex)
def test_they_are_passed_over(tmp_path, kind):
    path, out = tmp_path / "log.mcap", tmp_path / "recovered.mcap"
    write(path, kind)
    assert [record.sequence for record in LogReader(path)] == [0, 1, 2, 3, 4, 5]
    summary = summarise(path)
    assert (summary.sound, summary.to_dict()["messages"]) == (True, 6)
    recovery = recover(path, out)
    assert (recovery.complete, recovery.damage, recovery.saved) == (True, (), {"/x": 6})
    assert list(LogReader(out)) == list(LogReader(path))


@pytest.mark.parametrize("kind", [0x00, 0x01, 0x09, 0x0F], ids=hex)
def test_a_kind_that_has_no_place_in_a_chunk_is_damage_to_readers_too(tmp_path, kind):
    path, other = tmp_path / "log.mcap", unknown(kind, 0)
    data = packed(CHANNEL) + MESSAGES[0] + other + MESSAGES[1]
    chunk = packed(Chunk("", data, 10, 0, zlib.crc32(data), len(data)))
    path.write_bytes(MAGIC + packed(Header("", "other")) + chunk + packed(DataEnd(0)) + packed(Footer(0, 0, 0)) + MAGIC)
    read: list[Any] = []
    with pytest.raises(LogError, match=f"a record of kind {kind} in a chunk"):
        read.extend(record.sequence for record in LogReader(path))
    assert not summarise(path).sound


def test_a_flood_of_records_that_are_no_messages_is_damage_at_once(tmp_path, monkeypatch):
    """64 MiB of empty ones would take a minute to pass over, and hold nothing."""
    monkeypatch.setattr("recorders.mcap_format.chunk_contents.MAX_OTHER_RECORDS", 5)
    path = tmp_path / "log.mcap"
    for others, sound in ((4, True), (5, False)):  # and the channel
        data = packed(CHANNEL) + MESSAGES[0] + unknown(0x42, 0) * others + MESSAGES[1]
        chunk = packed(Chunk("", data, 10, 0, zlib.crc32(data), len(data)))
        tail = packed(DataEnd(0)) + packed(Footer(0, 0, 0)) + MAGIC
        path.write_bytes(MAGIC + packed(Header("", "other")) + chunk + tail)
        assert summarise(path).sound == sound
        if sound:
            assert len(list(LogReader(path))) == 2
        else:
            with pytest.raises(LogError, match="more than 5 records that are no messages"):
                list(LogReader(path))
