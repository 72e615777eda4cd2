"""Logs that claim or hold more than the memory: what is too large is passed over in words, in bounded memory."""

import json
import os
import struct
import subprocess
import sys
from pathlib import Path

import hostile
import peaks
import pytest
from hostile import chunk, message, small

from recorders.errors import LogError
from recorders.reader import LogReader
from recorders.record_lengths import MAX_CHUNK

MOST = 256_000_000  # bytes: what is promised of a process that reads logs
SOUND = 3  # messages in each sound chunk beside what is hostile
GIB = 2**30
LARGER = 280_000_000  # bytes: more than the memory that is promised


def peaks_of(*tried: tuple[str, Path]) -> list:
    """Return result and peak [bytes] of each thing done with a log, of one process that forks for each."""
    found = subprocess.run(
        [sys.executable, peaks.__file__, *(f"{what}:{path}" for what, path in tried)],
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, "PYTHONPATH": str(Path(peaks.__file__).parents[2])},
    )
    return json.loads(found.stdout)


@pytest.mark.parametrize("compression", ["zstd", "lz4"])
def test_a_chunk_that_swells_is_passed_over(tmp_path, compression):
    stored = hostile.zeros(GIB, compression)
    true = hostile.log(tmp_path / "true.mcap", [small(), chunk(b"", compression, size=GIB, stored=stored), small(2)])
    false = hostile.log(tmp_path / "false.mcap", [small(), chunk(b"", compression, size=6 * 10**7, stored=stored)])
    found = peaks_of(("read", true), ("info", true), ("recover", true), ("read", false), ("info", false))
    assert max(peak for _, peak in found) < MOST
    (read, _), (info, _), (recovered, _), (read_false, _), (info_false, _) = found
    assert read.startswith("TooLarge")
    assert f"claims {GIB} bytes" in read
    assert (info["messages"], info["sound"]) == (2 * SOUND, False)
    assert f"claims {GIB} bytes" in info["damage"][0]
    assert recovered == {"kept": 2 * SOUND, "complete": False, "again": 2 * SOUND, "names": []}
    assert read_false.startswith("DamagedLog")
    assert "claims 60000000" in read_false
    assert (info_false["messages"], info_false["sound"]) == (SOUND, False)


def test_the_largest_chunk_that_is_read_fits_into_the_memory(tmp_path):
    data = os.urandom(MAX_CHUNK - 100)
    whole = hostile.channel(1, "/sound/1") + message(1, data)
    log = hostile.log(tmp_path / "large.mcap", [chunk(whole, "zstd"), chunk(whole, "lz4"), chunk(whole, "")])
    found = peaks_of(("read", log), ("info", log), ("recover", log))
    assert [result for result, _ in found] == [
        3,
        {"messages": 3, "sound": True, "damage": []},
        {"kept": 3, "complete": True, "again": 3, "names": []},
    ]
    assert max(peak for _, peak in found) < MOST


def test_large_records_beside_the_chunks_are_passed_over_or_copied_in_pieces(tmp_path):
    bare = [hostile.channel(7, "/large"), *hostile.bare_message(7, LARGER)]
    log = hostile.log(tmp_path / "log.mcap", [small(), *hostile.attachment("large", LARGER), *bare, small(2)])
    count = 2 * SOUND + 1
    found = peaks_of(("read_topic", log), ("info", log), ("recover", log))
    assert [result for result, _ in found] == [
        SOUND,
        {"messages": count, "sound": True, "damage": []},
        {"kept": count, "complete": True, "again": count, "names": ["large"]},
    ]
    assert max(peak for _, peak in found) < MOST
    with pytest.raises(LogError, match=f"an attachment of {LARGER} bytes"):
        LogReader(log).attachment("large")


def test_a_message_larger_than_any_chunk_is_read_where_it_is_asked_for(tmp_path):
    log = hostile.log(tmp_path / "log.mcap", [hostile.channel(7, "/large"), *hostile.bare_message(7, LARGER)])
    (found,) = LogReader(log)
    assert len(found.data) == LARGER
    assert not found.data.strip(b"\0")
    assert list(LogReader(log).records(start_ns=1)) == []


@pytest.mark.parametrize("damaged", [False, True])
def test_a_large_attachment_is_checked_and_copied_to_the_bit(tmp_path, damaged):
    size = 2**24 + 5
    records = list(hostile.attachment("large", size))
    if damaged:
        records[-1] = struct.pack("<I", 1)
    log = hostile.log(tmp_path / "log.mcap", [small(), *records, small(2)])
    ((info, _), (recovered, _)) = [peaks.peak(what, str(log)) for what in ("info", "recover")]
    assert (info["sound"], info["messages"]) == (not damaged, 2 * SOUND)
    assert recovered["names"] == ([] if damaged else ["large"])
    if not damaged:
        assert LogReader(log).attachment("large") == bytes(size)
