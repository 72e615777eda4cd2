"""Bags that cannot be read: one line that says what was expected and what would help, in little memory."""

import sqlite3
import tracemalloc

import bags
import pytest
from rosbags.rosbag2 import CompressionMode, StoragePlugin

from recorders.containers import ros1_bag
from recorders.containers.opening import open_log
from recorders.containers.unpacked import copies
from recorders.errors import LogError


def complaint(path):
    with pytest.raises(LogError) as caught:
        list(open_log(path).records())
    line = str(caught.value)
    assert "\n" not in line
    assert len(line) < 600
    return line


@pytest.mark.parametrize("storage", list(StoragePlugin))
def test_a_bag_whose_part_is_missing(tmp_path, storage):
    folder = bags.bag_folder(tmp_path / "bag", storage=storage, count=1)
    (part,) = (path for path in folder.iterdir() if path.suffix != ".yaml")
    part.unlink()
    assert f"{part.name} missing: expected the file that metadata.yaml names, found 0" in complaint(folder)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", "expected the metadata of a rosbag2 recording"),
        ("[", "expected the metadata of a rosbag2 recording"),
        ("a: &a [*a, *a]", "expected the metadata of a rosbag2 recording"),
        ("[" * 5000 + "]" * 5000, "expected the metadata of a rosbag2 recording"),
        ("rosbag2_bagfile_information: {storage_identifier: mcap}", "expected the files of a rosbag2 recording"),
        ("!!python/object/apply:os.system [ls]", "expected the metadata of a rosbag2 recording"),
        ("rosbag2_bagfile_information: &a {storage_identifier: mcap, relative_file_paths: [*a]}", "without aliases"),
        (
            "rosbag2_bagfile_information: {storage_identifier: mcap, relative_file_paths: [[a, b]]}",
            "expected the files of a rosbag2 recording",
        ),
        (
            "rosbag2_bagfile_information: {storage_identifier: mcap, relative_file_paths: [a], compression_mode: [b]}",
            "expected texts for compression_mode",
        ),
    ],
)
def test_metadata_of_something_else(tmp_path, text, expected):
    (tmp_path / "metadata.yaml").write_text(text)
    assert expected in complaint(tmp_path)


def test_a_file_outside_of_the_folder_is_not_read(tmp_path):
    folder = bags.bag_folder(tmp_path / "bag", count=1)
    (folder / "bag.db3").rename(tmp_path / "bag.db3")
    text = (folder / "metadata.yaml").read_text()
    (folder / "metadata.yaml").write_text(text.replace("- bag.db3", "- ../bag.db3"))
    assert "bag.db3 missing" in complaint(folder)


def test_a_storage_that_nobody_knows_names_what_helps(tmp_path):
    folder = bags.bag_folder(tmp_path / "bag", count=1)
    text = (folder / "metadata.yaml").read_text()
    (folder / "metadata.yaml").write_text(text.replace("storage_identifier: sqlite3", "storage_identifier: leveldb"))
    assert "found 'leveldb'; `ros2 bag convert` it" in complaint(folder)


def test_sqlite_of_something_else(tmp_path):
    path = tmp_path / "notes.db3"
    with sqlite3.connect(path) as connection:
        connection.execute("CREATE TABLE notes (text)")
    connection.close()
    assert "found an sqlite file without topics and messages" in complaint(path)


def test_a_view_in_place_of_the_messages_is_not_computed(tmp_path):
    path = tmp_path / "endless.db3"
    with sqlite3.connect(path) as connection:
        connection.execute("CREATE TABLE topics (id INTEGER, name, type, serialization_format)")
        connection.execute(
            "CREATE VIEW messages AS WITH RECURSIVE n(id) AS (SELECT 1 UNION ALL SELECT id + 1 FROM n) "
            "SELECT id, 1 AS topic_id, id AS timestamp, x'00' AS data FROM n"
        )
    connection.close()
    assert "found an sqlite file without topics and messages" in complaint(path)


def test_metadata_that_doubles_itself_is_not_written_out(tmp_path):
    levels = "".join(f"a{level}: &a{level} [*a{level - 1}, *a{level - 1}]\n" for level in range(1, 28))
    about = "rosbag2_bagfile_information: {storage_identifier: mcap, relative_file_paths: [x], compression_mode: *a27}"
    (tmp_path / "metadata.yaml").write_text(f"a0: &a0 [x, x]\n{levels}{about}\n")
    tracemalloc.start()
    try:
        assert "without aliases" in complaint(tmp_path)
        assert tracemalloc.get_traced_memory()[1] < 2**24
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("column", ["name", "type"])
def test_sqlite_whose_columns_are_computed_is_refused(tmp_path, column):
    path = tmp_path / "long.db3"
    with sqlite3.connect(path) as connection:
        other = "type" if column == "name" else "name"
        connection.execute(
            f"CREATE TABLE topics (id INTEGER PRIMARY KEY, {other} TEXT, serialization_format TEXT, "
            f"{column} TEXT GENERATED ALWAYS AS (id || printf('%.*c', 1000000, 'x')))"
        )
        connection.execute("CREATE TABLE messages (id INTEGER PRIMARY KEY, topic_id, timestamp, data)")
        connection.executemany("INSERT INTO topics (id) VALUES (?)", [(number,) for number in range(20)])
    connection.close()
    assert "found an sqlite file without topics and messages in plain tables" in complaint(path)


@pytest.mark.parametrize(("rows", "size"), [(1, 2**20 + 1), (100, 2**20 - 100)])
def test_sqlite_with_more_names_than_are_held_is_refused(tmp_path, rows, size):
    path = tmp_path / "names.db3"
    with sqlite3.connect(path) as connection:
        connection.execute("CREATE TABLE topics (id INTEGER PRIMARY KEY, name, type)")
        connection.execute("CREATE TABLE messages (id INTEGER PRIMARY KEY, topic_id, timestamp, data)")
        connection.executemany("INSERT INTO topics (id) VALUES (?)", [(number,) for number in range(rows)])
        # rows that were there before a column have its default: a short file of long names
        connection.execute(f"ALTER TABLE topics ADD COLUMN serialization_format TEXT DEFAULT '{'x' * size}'")
    connection.close()
    expected = "bytes of topics, the most that is held" if rows > 1 else "not a sound rosbag2 recording in sqlite"
    assert expected in complaint(path)


def test_sqlite_that_is_damaged(tmp_path):
    path = bags.bag_folder(tmp_path / "bag") / "bag.db3"
    data = bytearray(path.read_bytes())
    data[4096 * 3 :] = b"\xff" * (len(data) - 4096 * 3)
    path.write_bytes(data)
    assert "not a sound rosbag2 recording in sqlite" in complaint(path)


def test_messages_that_were_not_moved_into_the_file_yet_are_read(tmp_path):
    path = bags.bag_folder(tmp_path / "bag", count=4) / "bag.db3"
    whole = [record.data for record in open_log(path)]
    connection = sqlite3.connect(path)
    connection.execute("PRAGMA journal_mode=WAL")
    connection.execute("INSERT INTO messages (topic_id, timestamp, data) VALUES (1, 999999999999999999, x'0001')")
    connection.commit()  # and its recorder is gone before it moves them
    before = sorted(path.parent.iterdir())
    try:
        assert [record.data for record in open_log(path)] == [b"\0\1", *whole]
        assert sorted(path.parent.iterdir()) == before
    finally:
        connection.close()


def test_files_are_copied_once_as_long_as_they_are_as_they_were(tmp_path):
    bag, journal = tmp_path / "bag.db3", tmp_path / "bag.db3-wal"
    bag.write_bytes(b"1")
    journal.write_bytes(b"22")
    first = copies(bag, journal)
    assert copies(bag, journal) == first
    journal.write_bytes(b"333")
    second = copies(bag, journal)
    assert second != first
    assert second.with_name(journal.name).read_bytes() == b"333"
    assert first.with_name(journal.name).read_bytes() == b"22"


def test_ros1_chunks_without_the_topics_that_are_asked_for_are_not_read(tmp_path, monkeypatch):
    path = bags.ros1_bag(tmp_path / "log.bag", order=sorted)
    whole = [record for record in open_log(path) if record.topic == bags.POSE]
    offsets: list[int] = []
    chunk_data = ros1_bag._chunk_data

    def noted(file, offset):
        offsets.append(offset)
        return chunk_data(file, offset)

    monkeypatch.setattr(ros1_bag, "_chunk_data", noted)
    assert list(open_log(path).records(topics=[bags.POSE])) == whole
    read, offsets[:] = len(offsets), []
    assert sorted(open_log(path).records(topics=[bags.POSE], file_order=True)) == sorted(whole)
    assert len(offsets) == read
    list(open_log(path))
    assert 0 < read < len(offsets) - read


def test_nothing_is_written_beside_a_bag(tmp_path):
    folder = bags.bag_folder(tmp_path / "bag", mode=CompressionMode.FILE, count=1)
    before = {path: path.read_bytes() for path in folder.iterdir()}
    list(open_log(folder))
    assert {path: path.read_bytes() for path in folder.iterdir()} == before


@pytest.mark.parametrize("mode", [CompressionMode.FILE, CompressionMode.MESSAGE])
def test_compressed_content_that_is_damaged(tmp_path, mode):
    folder = bags.bag_folder(tmp_path / "bag", mode=mode, count=1)
    if mode == CompressionMode.FILE:
        (packed,) = folder.glob("*.zstd")
        whole = packed.read_bytes()
        for data in (whole[:100] + b"\0" * 400, whole[:-1], whole[:2000], whole + b"more", b""):
            packed.write_bytes(data)
            assert packed.name in complaint(folder)
    else:
        with sqlite3.connect(folder / "bag.db3") as connection:
            connection.execute("UPDATE messages SET data = x'28B52FFDFFFF'")
        connection.close()
        assert "does not decompress" in complaint(folder)


def test_ros1_bag_cut_off_anywhere_is_one_line(tmp_path):
    whole = bags.ros1_bag(tmp_path / "whole.bag").read_bytes()
    path = tmp_path / "cut.bag"
    for end in (*range(20, 200, 7), *range(4200, len(whole), 1511), len(whole) - 1):
        path.write_bytes(whole[:end])
        complaint(path)


def test_ros1_bag_without_an_index_names_what_makes_one(tmp_path):
    data = bags.ros1_bag(tmp_path / "log.bag").read_bytes()
    place = data.index(b"index_pos=") + len(b"index_pos=")
    (tmp_path / "log.bag").write_bytes(data[:place] + bytes(8) + data[place + 8 :])
    assert "`rosbag reindex` makes one" in complaint(tmp_path / "log.bag")


@pytest.mark.parametrize("name", [b"index_pos=", b"chunk_pos="])
@pytest.mark.parametrize("offset", [2**40, 2**63 - 1, 2**63, 2**64 - 1])
def test_ros1_offsets_are_not_believed(tmp_path, name, offset):
    path = bags.ros1_bag(tmp_path / "log.bag")
    data = path.read_bytes()
    place = data.index(name) + len(name)
    path.write_bytes(data[:place] + offset.to_bytes(8, "little") + data[place + 8 :])
    assert f"it names a record at byte {offset}, and ends at byte {len(data)}" in complaint(path)


def test_ros1_lengths_are_not_believed(tmp_path):
    data = bags.ros1_bag(tmp_path / "log.bag", compression="LZ4").read_bytes()
    place = data.index(b"size=") + len(b"size=")
    for size in (1, 2**26, 2**32 - 1):
        (tmp_path / "log.bag").write_bytes(data[:place] + size.to_bytes(4, "little") + data[place + 4 :])
        assert "the bag is damaged" in complaint(tmp_path / "log.bag")


def test_ros1_messages_out_of_order_come_in_order(tmp_path):
    expected = sorted(record for record in open_log(bags.ros1_bag(tmp_path / "log.bag")))
    shuffled = bags.ros1_bag(tmp_path / "mixed.bag", order=lambda rows: rows[1::2] + rows[::2])
    found = list(open_log(shuffled))
    assert sorted(found) == expected
    assert [record.log_time_ns for record in found] == sorted(record.log_time_ns for record in found)
    in_file = [record.log_time_ns for record in open_log(shuffled).records(file_order=True)]
    assert in_file != sorted(in_file)


@pytest.mark.parametrize(
    ("begin", "expected"),
    [
        (b"\x89HDF\r\n\x1a\n", "HDF5; write its joints and poses to MCAP"),
        (b"PAR1....", "Parquet"),
        (b"\x28\xb5\x2f\xfd....", "`zstd -d` decompresses it"),
        (b"\x1f\x8b......", "`gunzip` decompresses it"),
        (b"#ROSBAG V1.2\n", "a bag of ROS 1"),
    ],
)
def test_what_is_no_log_names_what_would_help(tmp_path, begin, expected):
    (tmp_path / "log").write_bytes(begin)
    assert expected in complaint(tmp_path / "log")
