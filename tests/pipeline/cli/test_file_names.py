"""Files whose names are no UTF-8, as a disk of another system may bring them, are files like any other."""

import json
import os
from pathlib import Path

import pytest
from episodes import write_episode

from pipeline.cli import app

BYTES = b"d\xe9mo"  # Latin-1
SHOWN = "d\\udce9mo"  # as it is printed


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of such a name, with a log, a controller and a CSV file of it."""
    folder = tmp_path_factory.mktemp("names") / os.fsdecode(BYTES)
    folder.mkdir()
    write_episode(named(folder, "mcap"), samples=6)
    rows = [f"{0.2 * k:.1f},0.32,{0.2 + 0.001 * k:.3f},0.76,0.32,-0.2,0.76" for k in range(4)]
    named(folder, "csv").write_text("\n".join(["t,lx,ly,lz,rx,ry,rz", *rows]) + "\n")
    with pytest.raises(SystemExit):
        app.main(["train", str(named(folder, "mcap")), "--out", str(named(folder, "npz")), "--epochs", "1"])
    return folder


def named(folder: Path, ending: str) -> Path:
    return folder / os.fsdecode(BYTES + b"." + ending.encode())


@pytest.mark.parametrize(
    ("line", "made"),
    [
        ("info LOG", None),
        ("recover LOG --out OUT.mcap", "out.mcap"),
        ("convert LOG --out OUT.mcap", "out.mcap"),
        ("train LOG --epochs 1 --out OUT.npz", "out.npz"),
        ("train LOG --as-live --out OUT.npz", "out.npz"),
        ("evaluate CONTROLLER LOG", None),
        ("evaluate CONTROLLER CSV", None),
        ("diff LOG LOG", None),
        ("diff CONTROLLER CONTROLLER", None),
        ("view LOG --save OUT.rrd", "out.rrd"),
        ("view CONTROLLER --motion LOG --save OUT.rrd", "out.rrd"),
        ("explore --motion CSV --out OUT.mcap", "out.mcap"),
        ("demonstrate CSV --out OUT.mcap", "out.mcap"),
        ("demonstrate LOG --out OUT.mcap --on-unreachable clip", "out.mcap"),
    ],
)
@pytest.mark.parametrize("as_json", [False, True], ids=["plain", "json"])
def test_a_verb_reads_writes_and_prints_such_names(
    folder: Path, tmp_path: Path, line: str, made: str | None, as_json: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / os.fsdecode(BYTES)
    out.mkdir()
    files = {"LOG": named(folder, "mcap"), "CONTROLLER": named(folder, "npz"), "CSV": named(folder, "csv")}
    words = [str(files.get(word, word)) for word in line.split()]
    words = [word.replace("OUT", str(out / "out")) for word in words]
    with pytest.raises(SystemExit) as end:
        app.main([*words, *(["--json"] if as_json else [])])
    found = capsys.readouterr()
    assert end.value.code == 0, found.err
    assert found.err == ""
    assert found.out
    if as_json:
        json.loads(found.out)
    if made is not None:
        assert (out / f"out{Path(made).suffix}").stat().st_size > 0


@pytest.mark.parametrize("verb", ["info", "train --out x.npz", "view --save x.rrd", "recover --out x.mcap"])
def test_a_line_that_names_such_a_file_is_one_line(
    tmp_path: Path, verb: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as end:
        app.main([*verb.split(), str(named(tmp_path, "mcap"))])
    assert end.value.code == 2
    error = capsys.readouterr().err
    assert f"{SHOWN}.mcap" in error
    assert error.count("\n") == 1
