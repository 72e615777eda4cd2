"""Tables hold every number of a recording, to the last bit, whatever container it was in."""

import csv
import json
import math
from pathlib import Path

import bags
import pytest

from recorders.errors import ConfigError, LogError, MessageError
from recorders.export.export import export
from recorders.messages.message_types import JointState, PoseStamped, TFMessage
from recorders.reading.reader import LogReader

FORMS = {
    "ros1": lambda folder: bags.ros1_bag(folder / "log.bag"),
    "db3": lambda folder: bags.bag_folder(folder / "bag"),
}


def of_csv(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def of_parquet(path: Path) -> list[dict[str, object]]:
    found = pytest.importorskip("pyarrow.parquet").read_table(path).to_pylist()
    return [dict(row) for row in found]


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize(("kind", "read"), [("csv", of_csv), ("parquet", of_parquet)])
def test_every_number_is_in_the_table_of_its_topic(tmp_path: Path, form: str, kind: str, read) -> None:
    if kind == "parquet":
        pytest.importorskip("pyarrow")
    result = export(FORMS[form](tmp_path), tmp_path / "tables", form=kind)
    assert result.rows == {bags.JOINTS: 40, bags.POSE: 40, bags.ODOMETRY: 40, bags.TF: 10}
    assert sorted((tmp_path / "tables").iterdir()) == sorted(result.files.values())
    tables = {topic: iter(read(path)) for topic, path in result.files.items()}
    for topic, message, time_ns in bags.messages():
        row = next(tables[topic])
        assert int(row["log_time_ns"]) == time_ns
        match message:
            case JointState():
                assert [float(row[f"position.{name}"]) for name in message.name] == message.position.tolist()
                assert math.isnan(float(row["velocity.elbow"]))
                assert float(row["velocity.wrist"]) == 0.5
                assert int(row["header.stamp.sec"]) * 10**9 + int(row["header.stamp.nanosec"]) == message.stamp_ns
            case PoseStamped():
                pose = "pose.pose" if topic == bags.ODOMETRY else "pose"
                assert [float(row[f"{pose}.position.{axis}"]) for axis in "xyz"] == message.position.tolist()
            case TFMessage():
                assert '"child_frame_id": "tool"' in row["transforms"]
    assert all(next(table, None) is None for table in tables.values())


def as_json(path: Path, rows: list[tuple[str, dict[str, object]]]) -> Path:
    values = [
        (topic, "json", "Any", ("jsonschema", b"{}"), json.dumps(fields).encode(), step)
        for step, (topic, fields) in enumerate(rows)
    ]
    return bags.mcap_file(path, values)


def test_texts_stay_texts_and_numbers_numbers(tmp_path: Path) -> None:
    """A text may look like a number, names of joints may be of something else, and a joint may be there twice."""
    rows: list[tuple[str, dict[str, object]]] = [
        ("/text", {"label": "Infinity", "value": math.inf, "values": [math.nan, 1.5]}),
        ("/text", {"label": "NaN", "value": 0.5}),
        ("/one", {"name": ["a", "b"], "position": 0.25, "effort": {"x": 1}}),
        ("/odd", {"name": [["a"], 3], "position": [1, 2]}),
        ("/twice", {"name": ["a", "b", "a"], "position": [1, 2, 3]}),
    ]
    files = export(as_json(tmp_path / "log.mcap", rows), tmp_path / "tables").files
    first, second = of_csv(files["/text"])
    assert (first["label"], first["value"], first["values"]) == ("Infinity", "inf", '["NaN", 1.5]')
    assert (second["label"], second["value"]) == ("NaN", "0.5")
    (one,) = of_csv(files["/one"])
    assert (one["position"], one["effort.x"]) == ("0.25", "1")
    (odd,) = of_csv(files["/odd"])
    assert (odd["name"], odd["position"]) == ('[["a"], 3]', "[1, 2]")
    (twice,) = of_csv(files["/twice"])
    assert (twice["name"], twice["position"]) == ('["a", "b", "a"]', "[1, 2, 3]")
    pytest.importorskip("pyarrow")
    files = export(tmp_path / "log.mcap", tmp_path / "more", form="parquet").files
    assert [row["label"] for row in of_parquet(files["/text"])] == ["Infinity", "NaN"]


@pytest.mark.parametrize(("kind", "read"), [("csv", of_csv), ("parquet", of_parquet)])
def test_whole_numbers_of_any_size_are_in_the_table(tmp_path: Path, kind: str, read) -> None:
    numbers: dict[str, list[object]] = {
        "/signed": [-(2**63), 2**63 - 1],
        "/unsigned": [2**64 - 1, 2**63, 0],
        "/both": [2**63, -1],
        "/huge": [10**400, 1, 0.5],
    }
    rows: list[tuple[str, dict[str, object]]] = [
        (topic, {"x": number}) for topic, values in numbers.items() for number in values
    ]
    if kind == "parquet":
        pytest.importorskip("pyarrow")
    files = export(as_json(tmp_path / "log.mcap", rows), tmp_path / "tables", form=kind).files
    for topic, values in numbers.items():
        as_texts = kind == "csv" or topic in ("/both", "/huge")
        assert [row["x"] for row in read(files[topic])] == (list(map(str, values)) if as_texts else values)


def test_a_recording_is_read_twice_however_many_topics_it_has(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rows = [(f"/topic/{number}", {"x": number}) for number in range(30)]
    log = as_json(tmp_path / "log.mcap", rows)
    reads: list[object] = []
    records = LogReader.records

    def counted(self, **options):
        reads.append(options)
        return records(self, **options)

    monkeypatch.setattr(LogReader, "records", counted)
    assert export(log, tmp_path / "tables").rows == dict.fromkeys([topic for topic, _ in rows], 1)
    assert len(reads) == 2


def test_topics_are_chosen(tmp_path: Path) -> None:
    assert set(export(bags.cdr_mcap(tmp_path / "a.mcap"), tmp_path / "x", topics=["/t*"]).files) == {bags.POSE, bags.TF}


def test_bad_input_is_one_line_and_leaves_no_folder(tmp_path: Path) -> None:
    log = bags.cdr_mcap(tmp_path / "a.mcap")
    odd = bags.mcap_file(tmp_path / "odd.mcap", [("/odd", "flatbuffer", "Odd", ("flatbuffer", b"x"), b"1", 1)])
    for error, text, words in (
        (ConfigError, "--format: expected csv, parquet or lerobot", {"log": log, "form": "xls"}),
        (LogError, "no topic /nobody", {"log": log, "topics": ["/nobody"]}),
        (LogError, "expected messages that can be decoded, found none: expected a type in one of", {"log": odd}),
        (MessageError, "expected a type in one of the encodings", {"log": odd, "topics": ["/odd"]}),
    ):
        with pytest.raises(error) as caught:
            export(**words, out=tmp_path / "tables")
        assert text in str(caught.value)
        assert "\n" not in str(caught.value)
        assert sorted(path.name for path in tmp_path.iterdir()) == ["a.mcap", "odd.mcap"]
    (tmp_path / "tables").mkdir()
    with pytest.raises(ConfigError, match="exists: choose another name"):
        export(log, tmp_path / "tables")
