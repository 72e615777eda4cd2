"""Tables hold every number of a recording, to the last bit, whatever container it was in."""

import csv
import math
from pathlib import Path

import bags
import pytest

from recorders.errors import ConfigError, LogError, MessageError
from recorders.export.export import export
from recorders.messages.message_types import JointState, PoseStamped, TFMessage

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


def test_topics_are_chosen(tmp_path: Path) -> None:
    assert set(export(bags.cdr_mcap(tmp_path / "a.mcap"), tmp_path / "x", topics=["/t*"]).files) == {bags.POSE, bags.TF}


def test_bad_input_is_one_line_and_leaves_no_folder(tmp_path: Path) -> None:
    log = bags.cdr_mcap(tmp_path / "a.mcap")
    odd = bags.mcap_file(tmp_path / "odd.mcap", [("/odd", "flatbuffer", "Odd", ("flatbuffer", b"x"), b"1", 1)])
    for error, text, words in (
        (ConfigError, "--format: expected one of csv, parquet", {"log": log, "form": "xls"}),
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
