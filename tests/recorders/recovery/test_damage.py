import struct
import tracemalloc
from collections import Counter
from contextlib import nullcontext, suppress

import pytest
from chunk_ends import chunk_ends, whole_before
from every_record import ATTACHMENT, MANIFEST, PRIVATE, write_every_record
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType, Writer

from recorders.errors import LogError
from recorders.mcap_format.errors import DamagedLog
from recorders.mcap_format.manifest import METADATA_NAME
from recorders.mcap_format.records import MAGIC
from recorders.reading.reader import LogReader

SLICE = {"start_ns": 1_030_000_000, "end_ns": 1_080_000_000}  # the middle of the first chunk to that of the second
MOST_BYTES = 4 << 20  # memory for a log of 4 kB: buffers and one piece of decompressed data
HUGE = (struct.pack("<Q", 2**60), struct.pack("<Q", 2**63 + 2**32), b"\xff\xff\xff\xff", b"\xff\xff\xff\x7f")


@pytest.fixture
def every(tmp_path):
    """A log that holds every kind of record, its bytes, and its messages."""
    path = tmp_path / "every.mcap"
    truth = write_every_record(path)
    return path, path.read_bytes(), truth


def until_damage(records):
    """Return the records before the damage, and the error (None if there was none)."""
    found = []
    try:
        for record in records:
            found.append(record)  # one by one: the last step may raise
    except LogError as error:
        return found, error
    return found, None


def check(path, truth, *, whole=0, protected=True):
    """Check that nothing wrong comes out of a log, and return what ended the reading of all its messages.

    `whole` is the number of messages that lie in sound chunks before the damage.
    """
    try:
        reader = LogReader(path)
    except LogError as error:  # not even the first bytes are there
        assert whole == 0
        return error
    in_time, _ = until_damage(reader)
    found, damage = until_damage(reader.records(file_order=True))
    assert in_time == sorted(found, key=lambda record: record.log_time_ns)
    assert found == truth[: len(found)]
    assert len(found) >= whole
    assert damage is None or "\n" not in str(damage)
    if isinstance(damage, DamagedLog):
        assert damage.path == path
        assert damage.last_time_ns == (found[-1].log_time_ns if found else None)
    else:
        assert (found, damage) == (truth, None)
    check_slices(reader, truth)
    check_contents(reader, truth, sound=damage is None, protected=protected)
    return damage


def check_slices(reader, truth):
    inside = [record for record in truth if SLICE["start_ns"] <= record.log_time_ns < SLICE["end_ns"]]
    found, error = until_damage(reader.records(**SLICE, file_order=True))
    assert found == inside if error is None else found == inside[: len(found)]
    one = [record for record in truth if record.topic == "/topic/2"]
    found, error = until_damage(reader.records(topics=["/topic/2"], file_order=True))
    assert found == one if error is None else found == one[: len(found)]


def check_contents(reader, truth, *, sound, protected):
    topics = dict.fromkeys(sorted({record.topic for record in truth}), "std_msgs/msg/String")
    expected = {
        "counts": Counter(record.topic for record in truth),
        "topics": topics,
        "manifest": MANIFEST,
        "attachments": ("robot.urdf",),
    }
    for name, value in expected.items():
        try:
            assert getattr(reader, name) == value, name
        except LogError:
            assert not sound, name
    with nullcontext() if sound else suppress(DamagedLog):
        assert reader.attachment("robot.urdf") == ATTACHMENT
    if sound:
        assert reader.protected == protected


def test_the_log_holds_every_kind_of_record(every):
    path, raw, truth = every
    kinds = set()
    with path.open("rb") as file:
        for record in StreamReader(file, emit_chunks=True, validate_crcs=True).records:
            kinds.add(type(record).__name__)
    expected = "Header Schema Channel Message Chunk MessageIndex ChunkIndex Attachment AttachmentIndex Statistics"
    assert kinds == {*expected.split(), "Metadata", "MetadataIndex", "SummaryOffset", "DataEnd", "Footer"}
    assert len(raw) < 40_000
    assert check(path, truth) is None
    assert LogReader(path).protected


STEPS = [7, pytest.param(1, marks=[pytest.mark.campaign, pytest.mark.timeout(3600)])]


@pytest.mark.parametrize("step", STEPS)
def test_cut_at_every_byte(every, tmp_path, step):
    sound, raw, truth = every
    ends = chunk_ends(sound)
    path = tmp_path / "cut.mcap"
    for size in range(0, len(raw), step):
        path.write_bytes(raw[:size])
        error = check(path, truth, whole=whole_before(ends, size))
        assert error is not None, size
        if size > len(MAGIC):
            assert isinstance(error, DamagedLog), size
            assert "cut off" in str(error), size


@pytest.mark.parametrize("step", STEPS)
def test_a_bit_flipped_at_every_byte(every, tmp_path, step):
    sound, raw, truth = every
    ends = chunk_ends(sound)
    path = tmp_path / "flipped.mcap"
    for place in range(0, len(raw), step):
        for bit in range(8) if step == 1 else (place % 8,):
            changed = bytearray(raw)
            changed[place] ^= 1 << bit
            path.write_bytes(changed)
            assert check(path, truth, whole=whole_before(ends, place)) is not None, (place, bit)


@pytest.mark.parametrize("step", [13, *STEPS[1:]])
def test_huge_numbers_at_every_byte_take_no_memory(every, tmp_path, step):
    path, raw, truth = every
    check(path, truth)  # once, so that what libraries keep is there
    path = tmp_path / "huge.mcap"
    tracemalloc.start()
    try:
        for place in range(len(MAGIC), len(raw), step):
            for number in HUGE if step == 1 else HUGE[place % len(HUGE) :][:1]:
                path.write_bytes(raw[:place] + number + raw[place + len(number) :])
                tracemalloc.reset_peak()
                before = tracemalloc.get_traced_memory()[0]
                check(path, truth)
                assert tracemalloc.get_traced_memory()[1] - before < MOST_BYTES, place
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("step", [61, pytest.param(3, marks=[pytest.mark.campaign, pytest.mark.timeout(3600)])])
def test_blocks_of_zeros_as_a_power_cut_leaves_them(every, tmp_path, step):
    _, raw, truth = every
    path = tmp_path / "zeros.mcap"
    chunks_end = raw.index(PRIVATE)  # messages beside chunks are protected by what stands at the end, and is lost
    for place in range(len(MAGIC), len(raw), step):
        if place < chunks_end:
            path.write_bytes(raw[:place] + bytes(len(raw) - place))
            assert isinstance(check(path, truth), DamagedLog), place
        path.write_bytes(raw[:place] + bytes(min(256, len(raw) - place)) + raw[place + 256 :])
        assert isinstance(check(path, truth), DamagedLog), place


def test_without_crcs_a_log_is_read_and_said_to_be_unprotected(tmp_path):
    path = tmp_path / "bare.mcap"
    truth = write_every_record(path, crcs=False)
    assert check(path, truth, protected=False) is None


def test_the_error_says_where_up_to_when_and_what_to_do(every, tmp_path):
    path, raw, truth = every
    second = raw.index(b"lz4") - 41  # head, times, size, CRC and the length of this name
    path.write_bytes(raw[: second + 60])
    _, error = until_damage(LogReader(path))
    assert (error.offset, error.last_time_ns, error.reason) == (second, truth[4].log_time_ns, "")
    assert str(error) == (
        f"{path}: the log is cut off at byte {second}, before its end was written; the last good message is of "
        "1.050000000 s; `reenact recover` saves what is whole"
    )


GROWN = 2**26  # bytes by which a length is damaged, in a file that is longer still


def enlarged(raw, place, end):
    """Return a log of which a length is damaged; what follows the log, as a long recording would, is added later."""
    (length,) = struct.unpack_from("<Q", raw, place)
    return raw[:place] + struct.pack("<Q", length + end) + raw[place + 8 :]


def peak_of_reading(path):
    tracemalloc.start()
    try:
        _, error = until_damage(LogReader(path))
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    return error, peak


@pytest.mark.parametrize("kind", ["chunk", "attachment", "metadata"])
def test_a_damaged_length_in_a_big_file_takes_no_memory(every, tmp_path, kind):
    _, raw, _ = every
    grown = 2**28 if kind == "metadata" else GROWN
    places = {
        "chunk": raw.index(b"lz4") - 40,
        "attachment": raw.index(b"robot.urdf") - 28,
        "metadata": raw.index(METADATA_NAME.encode()) - 12,
    }
    path = tmp_path / "big.mcap"
    with path.open("wb") as file:
        file.write(enlarged(raw, places[kind], grown))
        file.truncate(2 * grown)
    error, peak = peak_of_reading(path)
    assert isinstance(error, DamagedLog)
    assert peak < MOST_BYTES
    assert "is not as long as it states" in error.reason or "is the most" in error.reason


def test_a_sound_large_chunk_and_attachment_are_read(tmp_path):
    path, large = tmp_path / "large.mcap", bytes(2**24 + 1)
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.NONE)
        writer.start()
        writer.add_attachment(0, 0, "large", "", large)
        channel = writer.register_channel("/x", "bytes", 0)
        writer.add_message(channel, 1, large, 1)
        writer.finish()
    reader = LogReader(path)
    assert [record.data for record in reader] == [large]
    assert reader.attachment("large") == large
