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
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.terminal.log_tables import topic_lines
from recorders.errors import LogError
from recorders.mcap_format import lengths
from recorders.mcap_format.decompression import DECOMPRESS_ERRORS, decompress
from recorders.mcap_format.lengths import MAX_CHUNK, MAX_DECLARED
from recorders.messages.topic_patterns import chosen
from recorders.reading.reader import LogReader
from recorders.recovery.log_info import summarise
from recorders.recovery.recover import recover

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
        env={**os.environ, "PYTHONPATH": str(Path(peaks.__file__).parents[3])},
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


def channels(numbers, text=""):
    """Return a chunk of channels, each with a message."""
    declared = (hostile.channel(each, f"/topic/{each}/{text}") + message(each, b"x") for each in numbers)
    return chunk(b"".join(declared))


def test_more_channels_than_are_held_are_passed_over(tmp_path):
    """In a few hundred kilobytes, names of 300 MB."""
    many = [channels(range(first, first + 500), "a" * 10**5) for first in range(2, 3002, 500)]
    log = hostile.log(tmp_path / "log.mcap", [small(), *many, small(2)])
    (read, _), (info, _), (recovered, _) = found = peaks_of(("read", log), ("info", log), ("recover", log))
    assert max(peak for _, peak in found) < MOST
    assert read.startswith("TooLarge")
    assert (info["messages"], info["sound"], len(info["damage"])) == (2 * SOUND, False, len(many))
    assert f"more than {MAX_DECLARED} bytes of schemas and channels" in info["damage"][0]
    assert (recovered["kept"], recovered["complete"]) == (2 * SOUND, False)


def test_as_many_channels_as_there_can_be_are_read(tmp_path):
    most = 2**16 - 1
    many = [channels(range(first, min(first + 5000, most + 1))) for first in range(1, most + 1, 5000)]
    log = hostile.log(tmp_path / "log.mcap", many)
    found = peaks_of(("read", log), ("info", log), ("recover", log))
    assert [result for result, _ in found] == [
        most,
        {"messages": most, "sound": True, "damage": []},
        {"kept": most, "complete": True, "again": most, "names": []},
    ]
    assert max(peak for _, peak in found) < MOST
    summary = summarise(log)
    assert len(list(topic_lines(summary, 80))) < 2000
    assert chosen(summary.topics, summary.topics, option="--topic") == summary.topics.keys()


def test_metadata_are_held_one_after_another(tmp_path):
    """Short texts by the hundred thousand take twenty times their size."""
    pairs = b"".join(hostile.text(f"{number:05x}") + hostile.text("") for number in range(200_000))
    metadata = hostile.record(12, hostile.text("other") + struct.pack("<I", len(pairs)) + pairs)
    log = hostile.log(tmp_path / "log.mcap", [small(), *[metadata] * 10])
    ((info, peak),) = peaks_of(("info", log))
    assert info["sound"]
    assert peak < MOST


def test_what_recover_writes_of_long_names_is_read(tmp_path):
    log = hostile.log(
        tmp_path / "log.mcap", [channels(range(first, first + 500), "a" * 2000) for first in (1, 501, 1001)]
    )
    assert recover(log, tmp_path / "out.mcap").complete
    assert summarise(tmp_path / "out.mcap").sound
    assert LogReader(tmp_path / "out.mcap").manifest["counts"] is None


def check_it_ends(path, size):
    """Check that of forty chunks of a size some are passed over."""
    again = chunk(hostile.channel(1, "/sound/1") + message(1, bytes(size)))
    log = str(hostile.log(path, [again] * 40))
    (info, _), (read, _) = [peaks.peak(what, log) for what in ("info", "read")]
    assert 0 < info["messages"] < 40
    assert not info["sound"]
    assert info["messages"] + len(info["damage"]) == 40
    assert read.startswith("TooLarge")


def test_a_short_log_that_swells_in_many_chunks_has_an_end(tmp_path, monkeypatch):
    monkeypatch.setattr(lengths, "_EXPANDED", 10**6)
    check_it_ends(tmp_path / "log.mcap", 10**5)


@pytest.mark.campaign
def test_a_short_log_that_swells_to_gigabytes_has_an_end(tmp_path):
    check_it_ends(tmp_path / "log.mcap", 2**26)


@given(
    parts=st.lists(st.binary(max_size=200) | st.just(bytes(3 * 10**6)), max_size=5),
    skipped=st.lists(st.booleans(), min_size=6, max_size=6),
    compression=st.sampled_from(["lz4", "zstd"]),
)
@settings(max_examples=40)
def test_frames_one_after_another_are_one_chunk(parts, skipped, compression):
    """Empty frames, and frames to be skipped, among them."""
    skip = struct.pack("<II", 0x184D2A55, 3) + b"???"
    frames = [hostile.COMPRESS[compression](part) for part in parts]
    data = b"".join(frame + skip * each for frame, each in zip([b"", *frames], skipped, strict=False))
    whole = b"".join(parts)
    assert decompress(data, compression, len(whole)) == whole
    with pytest.raises(DECOMPRESS_ERRORS):
        decompress(data, compression, len(whole) + 1)
    if whole:
        with pytest.raises(DECOMPRESS_ERRORS):
            decompress(data, compression, len(whole) - 1)
