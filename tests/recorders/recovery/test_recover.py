"""A damaged log is recovered: what is whole is kept bit for bit, nothing else is, and the account of it is right."""

import random
import re
import struct
import zlib
from collections import Counter
from pathlib import Path

import lz4.frame
import pytest
import zstandard
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

from recorders.errors import CheckFailed, LogError
from recorders.mcap_format import records
from recorders.mcap_format.decompression import decompress
from recorders.mcap_format.manifest import content_sha256
from recorders.reading.reader import LogReader
from recorders.recovery.log_info import summarise
from recorders.recovery.recover import Recovery, recover
from recorders.recovery.survey import CUT_OFF, survey

TICKS = 40
MESSAGES = TICKS * 7  # the fixture's log: chunks of 64, 64, 64, 64 and 24 messages


def flipped(raw: bytes, place: int, bit: int = 0) -> bytes:
    return raw[:place] + bytes([raw[place] ^ 1 << bit]) + raw[place + 1 :]


def chunks_of(log: Path) -> list[tuple[int, int, int]]:
    """Return where each chunk begins and ends, and how many messages it holds, by the library's own reader."""
    with log.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    ends = [index.chunk_start_offset + index.chunk_length for index in summary.chunk_indexes]
    counts = [64] * (len(ends) - 1) + [MESSAGES - 64 * (len(ends) - 1)]
    return [
        (index.chunk_start_offset, end, n) for index, end, n in zip(summary.chunk_indexes, ends, counts, strict=True)
    ]


def recovered(raw: bytes, folder: Path) -> tuple[Recovery, Path]:
    damaged, out = folder / "damaged.mcap", folder / "good.mcap"
    damaged.write_bytes(raw)
    recovery = recover(damaged, out, overwrite=True)
    assert damaged.read_bytes() == raw
    return recovery, out


def test_of_a_sound_log_everything_is_kept(log, tmp_path):
    recovery, out = recovered(log.read_bytes(), tmp_path)
    assert list(LogReader(out)) == list(LogReader(log))
    assert (recovery.complete, recovery.damage, recovery.lost, recovery.exact) == (True, (), Counter(), True)
    assert LogReader(out).attachment("robot.urdf") == b"<robot/>"
    note = {"from": "damaged.mcap", "kept": MESSAGES, "lost": 0, "damage": []}
    assert LogReader(out).manifest == {**LogReader(log).manifest, "recovered": note}


@pytest.mark.parametrize("chunk", [0, 1, 4])
def test_a_flipped_bit_costs_its_chunk_alone(log, tmp_path, chunk):
    everything = list(LogReader(log))
    start, end, count = chunks_of(log)[chunk]
    recovery, out = recovered(flipped(log.read_bytes(), (start + end) // 2), tmp_path)
    kept = everything[: 64 * chunk] + everything[64 * chunk + count :]
    assert list(LogReader(out)) == kept
    lost = Counter(record.topic for record in everything[64 * chunk : 64 * chunk + count])
    assert (recovery.lost, recovery.exact, recovery.complete) == (lost, True, False)
    assert [damage.offset for damage in recovery.damage] == [start]
    manifest = LogReader(out).manifest
    assert (manifest["complete"], manifest["messages"]) == (False, len(kept))
    assert manifest["content_sha256"] == content_sha256(kept)
    assert manifest["environment"] == LogReader(log).manifest["environment"]
    assert manifest["recovered"]["lost"] == count
    assert manifest["recovered"]["damage"] == [{"offset": start, "reason": recovery.damage[0].reason}]


@pytest.mark.parametrize("place", [8, 9 + 16, 9 + 28])
def test_without_a_summary_the_next_chunk_is_found_by_its_crc(log, tmp_path, place):
    """The head of a chunk is damaged (length, sizes, compression), and so is the summary."""
    everything = list(LogReader(log))
    start, _, count = chunks_of(log)[2]
    raw = flipped(flipped(log.read_bytes(), start + place), -40 % log.stat().st_size)
    recovery, out = recovered(raw, tmp_path)
    assert list(LogReader(out)) == everything[:128] + everything[128 + count :]
    assert recovery.damage[0].offset == start
    assert recovery.lost is not None
    assert recovery.lost.total() == count  # by the manifest's counts


@pytest.mark.parametrize("kind", ["header", "attachment", "chunk"])
@pytest.mark.parametrize("place", range(1, 6))
@pytest.mark.parametrize("bit", range(8))
def test_a_record_that_claims_more_takes_no_chunk_with_it(log, tmp_path, kind, place, bit):
    """Its length is damaged, and the summary too: what it takes in of others is not lost."""
    everything, whole = list(LogReader(log)), log.read_bytes()
    start, _, count = chunks_of(log)[2]
    attachment = whole.index(b"robot.urdf") - 9 - 16 - 4
    at = {"header": 8, "attachment": attachment, "chunk": start}[kind]
    recovery, out = recovered(flipped(flipped(whole, at + place, bit), -40 % len(whole)), tmp_path)
    kept = list(LogReader(out))
    without = everything[:128] + everything[128 + count :]
    assert kept in ([everything, without] if kind == "chunk" else [everything])
    missing = Counter(record.topic for record in everything) - Counter(record.topic for record in kept)
    assert (recovery.saved.total(), recovery.lost) == (len(kept), missing)


def test_a_cut_off_log_tells_by_its_numbers_what_is_missing_before_the_cut(log, tmp_path):
    start, end, _ = chunks_of(log)[1]
    cut = chunks_of(log)[3][0] + 50
    recovery, _ = recovered(flipped(log.read_bytes()[:cut], (start + end) // 2), tmp_path)
    assert recovery.lost is not None
    assert (recovery.saved.total(), recovery.lost.total(), recovery.exact) == (128, 64, False)
    assert recovery.damage[-1].reason == CUT_OFF
    assert recovery.damage[-1].offset == chunks_of(log)[3][0]
    assert not recovery.complete


def test_of_a_log_that_is_merely_cut_off_nothing_tells_how_much_is_lost(log, tmp_path):
    recovery, out = recovered(log.read_bytes()[: chunks_of(log)[2][0]], tmp_path)
    assert (recovery.saved.total(), recovery.lost, recovery.exact) == (128, None, False)
    assert LogReader(out).manifest["recovered"]["lost"] is None
    assert LogReader(out).manifest["robot"] == "asimo"  # a log says at its beginning what made it


def test_a_recovered_log_remembers_that_it_was_one(log, tmp_path):
    start, end, _ = chunks_of(log)[1]
    _, out = recovered(flipped(log.read_bytes(), (start + end) // 2), tmp_path)
    recover(out, tmp_path / "again.mcap")
    note = LogReader(tmp_path / "again.mcap").manifest["recovered"]
    assert note["earlier"] == LogReader(out).manifest["recovered"]
    assert not LogReader(tmp_path / "again.mcap").manifest["complete"]


@pytest.fixture(scope="module")
def module_log(tmp_path_factory):
    """A log of the same ticks, for the tests that draw many examples."""
    from importlib.util import module_from_spec, spec_from_file_location

    spec = spec_from_file_location("ticks_of_the_logs", Path(__file__).parents[1] / "conftest.py")
    ticks = module_from_spec(spec)
    spec.loader.exec_module(ticks)
    path = tmp_path_factory.mktemp("whole") / "log.mcap"
    with ticks.LogWriter(path, manifest={"robot": "asimo"}, attachments={"robot.urdf": b"<robot/>"}) as writer:
        for tick in range(TICKS):
            for topic, message in ticks.tick_messages(tick):
                writer.write(topic, message, log_time_ns=tick * ticks.TICK_NS)
    return path


def is_part_in_order(part, whole):
    rest = iter(whole)
    return all(record in rest for record in part)


def check_recovery(log: Path, raw: bytes, places: list[int], folder: Path) -> None:
    """Recover a log that is flipped at these places and may be cut off, and hold what comes out against the whole."""
    everything, chunks = list(LogReader(log)), chunks_of(log)
    whole = [end <= len(raw) and not any(start <= at < end for at in places) for start, end, _ in chunks]
    try:
        recovery, out = recovered(raw, folder)
    except LogError:
        assert raw[:8] != log.read_bytes()[:8]  # no log at all, or so it seems
        return
    except CheckFailed:
        assert not whole[0]
        return
    kept = list(LogReader(out))
    assert is_part_in_order(kept, everything)
    assert content_sha256(kept) == LogReader(out).manifest["content_sha256"]
    assert len(kept) == recovery.saved.total()
    assert recovery.complete <= (kept == everything)
    begin = 0
    for is_whole, (_, _, count) in zip(whole, chunks, strict=True):
        if is_whole and whole[0]:  # the first chunk declares every channel
            assert set(everything[begin : begin + count]) <= set(kept)
        begin += count


@settings(max_examples=100, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow])
@given(data=st.data())
def test_whatever_is_damaged_what_is_kept_is_right_and_what_is_whole_is_kept(module_log, tmp_path, data):
    raw = module_log.read_bytes()
    places = data.draw(st.lists(st.integers(0, len(raw) - 1), min_size=0, max_size=3), label="places")
    for place in places:
        raw = flipped(raw, place, data.draw(st.integers(0, 7), label="bit"))
    raw = raw[: data.draw(st.integers(8, len(raw)) | st.just(len(raw)), label="cut")]
    check_recovery(module_log, raw, places, tmp_path)


@pytest.mark.campaign
@pytest.mark.timeout(3600)
def test_every_byte_and_every_cut(module_log, tmp_path):
    raw = module_log.read_bytes()
    draw = random.Random(0)
    for place in range(len(raw)):
        check_recovery(module_log, flipped(raw, place, draw.randrange(8)), [place], tmp_path)
        if place >= 8:
            check_recovery(module_log, raw[:place], [], tmp_path)


def foreign(path: Path, **options: object) -> list[tuple]:
    """Write a log as other programs do, with a protobuf channel, one without a schema, and times of its own."""
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=300, **options)
        writer.start(profile="x", library="other")
        schema = writer.register_schema("foxglove.Pose", "protobuf", b"\x00descriptor")
        channels = [
            writer.register_channel("/pose", "protobuf", schema, {"a": "b"}),
            writer.register_channel("/raw", "bytes", 0),
            writer.register_channel("/joint_states", "protobuf", schema),  # one of our names, of another type
        ]
        writer.add_attachment(1, 2, "notes.txt", "text/plain", b"hello")
        writer.add_metadata("other", {"k": "v"})
        for index in range(60):
            writer.add_message(channels[index % 3], 100 - index, bytes([index]) * 20, 5 + index, index // 3)
        writer.finish()
    return whole_messages(path)


def whole_messages(path: Path) -> list[tuple]:
    """Return everything that the library's own reader says of the messages."""
    with path.open("rb") as file:
        return [
            (
                schema and (schema.name, schema.encoding, schema.data),
                (channel.topic, channel.message_encoding, channel.metadata),
                (message.sequence, message.log_time, message.publish_time, message.data),
            )
            for schema, channel, message in make_reader(file, validate_crcs=True).iter_messages(log_time_order=False)
        ]


@pytest.mark.parametrize("compression", CompressionType)
def test_logs_of_others_keep_channels_schemas_and_times(tmp_path, compression):
    path, out = tmp_path / "foreign.mcap", tmp_path / "good.mcap"
    everything = foreign(path, compression=compression)
    assert survey(path).damage == []
    start, end, _ = chunks_of_any(path)[2]
    path.write_bytes(flipped(path.read_bytes(), (start + end) // 2))
    recovery = recover(path, out)
    kept = whole_messages(out)
    assert 0 < len(kept) < 60
    assert is_part_in_order(kept, everything)
    assert recovery.lost is not None
    assert recovery.lost.total() == 60 - len(kept)
    assert [damage.offset for damage in recovery.damage] == [start]
    with out.open("rb") as file:
        reader = make_reader(file)
        assert reader.get_header().profile == "x"
        (attachment,) = reader.iter_attachments()
        metadata = {each.name: each.metadata for each in reader.iter_metadata()}
    assert (attachment.create_time, attachment.log_time, attachment.data) == (1, 2, b"hello")
    assert metadata["other"] == {"k": "v"}


def chunks_of_any(path: Path) -> list[tuple[int, int, int]]:
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    return [(x.chunk_start_offset, x.chunk_start_offset + x.chunk_length, 0) for x in summary.chunk_indexes]


@pytest.mark.parametrize("chunked", [True, False])
def test_what_no_crc_protects_is_kept_up_to_the_damage_and_said_to_be_in_doubt(tmp_path, chunked):
    path, out = tmp_path / "foreign.mcap", tmp_path / "good.mcap"
    everything = foreign(path, enable_crcs=False, use_chunking=chunked, compression=CompressionType.NONE)
    raw = path.read_bytes()
    place = raw.index(bytes([30]) * 20)  # a message in the middle
    path.write_bytes(raw[: place + 5])
    recovery = recover(path, out)
    kept = whole_messages(out)
    assert kept == everything[: len(kept)]
    assert 20 < len(kept) <= 30
    assert recovery.unprotected == len(kept)
    head = raw.rindex(b"\x05", 0, place) if not chunked else chunks_of_any_raw(raw, place)
    path.write_bytes(flipped(raw, head, 3))  # what stands there is no record that may stand there
    recovery = recover(path, out, overwrite=True)
    kept = whole_messages(out)
    assert kept == everything[: len(kept)]
    assert 20 < len(kept) <= 30
    assert len(recovery.damage) >= 1


def chunks_of_any_raw(raw: bytes, place: int) -> int:
    """Return where the chunk begins that holds a place."""
    return max(match.start() for match in re.finditer(rb"\x06.{5}\0{3}.{28}\0{4}", raw[:place], re.DOTALL))


def test_without_any_crc_of_its_own_a_changed_data_section_is_not_believed(tmp_path):
    path = tmp_path / "foreign.mcap"
    foreign(path, enable_data_crcs=True, use_chunking=False)
    assert survey(path).damage == []
    path.write_bytes(flipped(path.read_bytes(), path.read_bytes().index(bytes([30]) * 20)))
    recovery = recover(path, tmp_path / "good.mcap")  # the attachment has a CRC
    assert recovery.saved.total() == 0
    assert recovery.lost is not None
    assert recovery.lost.total() == 60


def test_a_chunk_that_became_a_record_of_another_kind_is_missed(tmp_path):
    """What is of no kind of ours is passed over; without a CRC over the data section only the counts tell."""
    path = tmp_path / "foreign.mcap"
    foreign(path)
    raw = path.read_bytes()
    path.write_bytes(flipped(raw, chunks_of_any(path)[1][0], 7))
    recovery = recover(path, tmp_path / "good.mcap")
    assert recovery.lost is not None
    assert recovery.lost.total() == 60 - recovery.saved.total() > 0
    assert not summarise(path).sound


def test_a_chunk_of_countless_records_of_no_kind_is_refused(tmp_path):
    """A few kB that decompress to a million times nothing: a list of those would take a hundred times as much."""
    size = 9 * 10**6
    data = lz4.frame.compress(bytes(size))
    head = struct.pack("<QQQII", 0, 0, size, zlib.crc32(bytes(size)), 3) + b"lz4" + struct.pack("<Q", len(data))
    path = tmp_path / "bomb.mcap"
    path.write_bytes(b"\x89MCAP0\r\n" + struct.pack("<BQ", 6, len(head) + len(data)) + head + data)
    with pytest.raises(CheckFailed, match="a record of kind 0 in a chunk"):
        recover(path, tmp_path / "good.mcap")


def test_a_log_of_nothing_stays_one(tmp_path):
    path = tmp_path / "empty.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        writer.finish()
    recovery = recover(path, tmp_path / "good.mcap")
    assert (recovery.saved, recovery.damage, recovery.complete) == (Counter(), (), True)


def test_an_index_that_became_a_message_is_not_believed(log, tmp_path):
    raw = log.read_bytes()
    index = chunks_of(log)[1][1]
    assert raw[index] == 7
    raw = raw[:index] + b"\x05" + raw[index + 1 : chunks_of(log)[3][1]]
    recovery, out = recovered(raw, tmp_path)
    assert list(LogReader(out)) == list(LogReader(log))[:256]
    assert not recovery.complete


def test_a_channel_whose_declaration_is_lost_is_counted_and_not_guessed(log, tmp_path):
    start, end, _ = chunks_of(log)[0]
    raw = flipped(log.read_bytes()[: chunks_of(log)[2][1]], (start + end) // 2)
    recovery, out = recovered(raw, tmp_path)
    assert (recovery.saved.total(), recovery.undeclared) == (0, 128)
    assert list(LogReader(out)) == []


def test_attachments_are_kept_or_counted_lost(log, tmp_path):
    raw = log.read_bytes().replace(b"<robot/>", b"<rabot/>")
    recovery, out = recovered(raw, tmp_path)
    assert list(LogReader(out)) == list(LogReader(log))
    assert (recovery.attachments, recovery.lost_attachments) == ((), ("robot.urdf",))


@pytest.mark.parametrize("content", [b"", b"\x89MCA", b"PK\x03\x04 and more", b"\x89MCAP1\r\n" + bytes(100)])
def test_what_is_no_log_at_all_is_refused(tmp_path, content):
    path = tmp_path / "x.mcap"
    path.write_bytes(content)
    with pytest.raises(LogError, match=r"x.mcap: expected an MCAP file, found"):
        recover(path, tmp_path / "good.mcap")
    assert sorted(tmp_path.iterdir()) == [path]


def test_a_log_without_anything_in_it_leaves_no_file(log, tmp_path):
    path = tmp_path / "head.mcap"
    path.write_bytes(log.read_bytes()[:30])
    with pytest.raises(CheckFailed, match="nothing in it can be believed"):
        recover(path, tmp_path / "good.mcap")
    assert not list(tmp_path.glob("good*"))


def test_the_original_is_never_written_to(log, tmp_path):
    raw = log.read_bytes()
    part = tmp_path / "session.mcap.part"
    part.write_bytes(raw)
    link = tmp_path / "link.mcap"
    link.symlink_to(log)
    while_written = "until it is whole it is called session.mcap.part, and "
    for source, out, why in ((log, log, ""), (log, link, ""), (part, tmp_path / "session.mcap", while_written)):
        with pytest.raises(LogError, match=f"{out.name}: {why}.* is the damaged log, which stays as it is; choose"):
            recover(source, out, overwrite=True)
    assert (log.read_bytes(), part.read_bytes()) == (raw, raw)


def test_a_log_of_that_name_is_overwritten_only_if_allowed(log, tmp_path):
    out = tmp_path / "good.mcap"
    out.write_bytes(records.MAGIC + b"precious")
    with pytest.raises(LogError, match="exists"):
        recover(log, out)
    assert out.read_bytes() == records.MAGIC + b"precious"
    recover(log, out, overwrite=True)
    assert list(LogReader(out)) == list(LogReader(log))


def test_an_interrupted_recovery_leaves_nothing(log, tmp_path):
    def interrupt(fraction: float) -> None:
        if fraction > 0.7:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        recover(log, tmp_path / "good.mcap", on_progress=interrupt)
    assert not list(tmp_path.glob("good*"))


def test_a_file_of_false_heads_ends_soon(tmp_path):
    """Each head claims a chunk that reaches to the end; searching them all would take the square of the size."""
    size = 2_000_000
    head = b"\x06" + size.to_bytes(8, "little") + bytes(16) + size.to_bytes(8, "little") + b"\1\1\1\1" + bytes(4)
    path = tmp_path / "hostile.mcap"
    path.write_bytes(b"\x89MCAP0\r\n" + (head + bytes(23)) * (size // 64))
    with pytest.raises(CheckFailed):
        recover(path, tmp_path / "good.mcap")


@pytest.mark.parametrize("between", [bytes(3), struct.pack("<BQHI", 7, 22, 1, 16) + bytes(16)])
def test_false_chunks_that_claim_much_are_not_all_decompressed(tmp_path, monkeypatch, between):
    """A few kB each that hold 2^26 bytes, with a CRC that does not hold, found by search or one after another."""
    size, count = 2**26, 20
    data = zstandard.ZstdCompressor(level=1).compress(bytes(size))
    head = struct.pack("<QQQII", 0, 0, size, 12345, 4) + b"zstd" + struct.pack("<Q", len(data))
    chunk = struct.pack("<BQ", 6, len(head) + len(data)) + head + data
    path = tmp_path / "bomb.mcap"
    path.write_bytes(b"\x89MCAP0\r\n" + between + (chunk + between) * count)
    found = []

    def counted(data, compression, size):
        found.append(size)
        return decompress(data, compression, size)

    monkeypatch.setattr(records, "decompress", counted)
    with pytest.raises(CheckFailed):
        recover(path, tmp_path / "good.mcap")
    assert sum(found) <= 3 * size


@pytest.mark.parametrize("bit", [28, 40])
def test_a_false_size_that_only_a_chunk_itself_tells_costs_that_chunk_alone(tmp_path, bit):
    """Some writers' zstd does not say how much it holds; what a damaged size claims is not held against the rest."""
    chunks = []
    for number in range(4):
        body = struct.pack("<HH", number + 1, 0) + b"\x02\0\0\0/x" + bytes(8)
        message = struct.pack("<HIQQ", number + 1, number, 0, 0) + b"data" * 99
        data = struct.pack("<BQ", 4, len(body)) + body + struct.pack("<BQ", 5, len(message)) + message
        packed = zstandard.ZstdCompressor(write_content_size=False).compress(data)
        size = len(data) ^ (1 << bit if number == 1 else 0)
        head = struct.pack("<QQQII", 0, 0, size, zlib.crc32(data), 4) + b"zstd" + struct.pack("<Q", len(packed))
        chunks.append(struct.pack("<BQ", 6, len(head) + len(packed)) + head + packed)
    path = tmp_path / "log.mcap"
    path.write_bytes(b"\x89MCAP0\r\n" + struct.pack("<BQ", 1, 8) + bytes(8) + b"".join(chunks))
    recover(path, tmp_path / "good.mcap")
    assert [record.sequence for record in LogReader(tmp_path / "good.mcap")] == [0, 2, 3]
