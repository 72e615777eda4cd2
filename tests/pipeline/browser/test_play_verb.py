"""The verb `play`: what it refuses in one line before anything is started."""

from pathlib import Path

import pytest

from pipeline.cli.app import main


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (["--host", "0.0.0.0"], "expected --token beside it"),
        (["--host", "0.0.0.0", "--token", "short"], "expected at least 16 letters and digits"),
        (["--connect", "tcp/127.0.0.1:1", "x.npz"], "expected none with --connect"),
        (["missing.npz"], "missing.npz"),
        (["--robot", "nobody"], "unknown robot 'nobody'"),
    ],
)
def test_what_cannot_be_shown_is_one_clear_line(arguments, line, tmp_path: Path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as ended:
        main(["play", "--no-browser", *arguments])
    assert ended.value.code == 2
    (printed,) = capsys.readouterr().err.strip().splitlines()
    assert printed.startswith("reenact: ")
    assert line in printed
    assert not list(tmp_path.iterdir())


def test_a_file_takes_no_recordings(tmp_path: Path, capsys):
    (tmp_path / "log.mcap").write_bytes(b"kept")
    with pytest.raises(SystemExit) as ended:
        main(["play", "--no-browser", "--out", str(tmp_path / "log.mcap")])
    assert ended.value.code == 2
    assert "--out: expected a folder for the recordings, found the file" in capsys.readouterr().err
    assert (tmp_path / "log.mcap").read_bytes() == b"kept"
