"""A project's settings are said once, in a file found upwards; the command line wins, and nothing in it is ignored."""

from pathlib import Path
from typing import Any

import pytest
import typer
from episodes import write_episode
from typer.testing import CliRunner

from pipeline.cli.app import app
from pipeline.cli.project_settings import find_settings, of_settings
from recorders.errors import ConfigError
from recorders.reading.reader import LogReader
from recorders.wire.loopback import free_endpoint

PROGRAM: Any = typer.main.get_command(app)


def defaults(folder: Path, text: str, *arguments: str, name: str = "reenact.toml") -> dict[str, Any]:
    (folder / name).write_text(text)
    settings = find_settings(folder)
    assert settings is not None
    return settings.default_map(PROGRAM, arguments)


def test_the_nearest_file_upwards_counts(tmp_path: Path) -> None:
    below = tmp_path / "a" / "b"
    below.mkdir(parents=True)
    (tmp_path / "reenact.toml").write_text('robot = "far"')
    (tmp_path / "a" / "pyproject.toml").write_text('[tool.other]\nrobot = "none"')
    found = find_settings(below)
    assert found is not None
    assert found.values == {"robot": "far"}
    (tmp_path / "a" / "pyproject.toml").write_text('[tool.reenact]\nrobot = "near"')
    found = find_settings(below)
    assert found is not None
    assert found.values == {"robot": "near"}


def test_an_option_holds_for_every_verb_that_has_it_and_a_table_for_its_own(tmp_path: Path) -> None:
    found = defaults(
        tmp_path, 'robot = "panda"\ntick-rate = 30\n[train]\ntick-rate = 10\n[golden.add]\ncases = "./g"\n'
    )
    assert found["train"]["robot"] == "panda"
    assert found["train"]["tick_rate"] == "10"
    assert found["evaluate"]["tick_rate"] == "30"
    assert found["golden"]["add"]["cases"] == str(tmp_path / "g")  # beside the file, wherever one works
    assert "robot" not in found["recover"]


@pytest.mark.parametrize(
    ("given", "left"),
    [((), {"connect"}), (("--listen", "tcp/x"), set()), (("--connect=tcp/x",), set()), (("--out", "x"), {"connect"})],
)
def test_an_endpoint_on_the_command_line_replaces_those_of_the_file(
    tmp_path: Path, given: tuple[str, ...], left: set[str]
) -> None:
    found = defaults(tmp_path, 'connect = ["tcp/127.0.0.1:9999"]\n', "learn", *given)
    assert found["learn"].keys() & {"connect", "listen"} == left


def test_the_settings_are_those_of_a_command_and_the_command_line_wins(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    of_file, given = free_endpoint(), free_endpoint()
    (tmp_path / "reenact.toml").write_text(f'connect = ["{of_file}"]\n')
    (tmp_path / "folder").mkdir()
    monkeypatch.chdir(tmp_path / "folder")
    assert f"nothing listens at {of_file}" in CliRunner().invoke(app, ["status"]).output
    assert f"nothing listens at {given}" in CliRunner().invoke(app, ["status", "--connect", given]).output


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("robt = 'panda'", "no verb has an option robt that a file sets"),
        ("[train]\nrat = 1", r"\[train\]: no option rat of this verb"),
        ("[tarin]\nepochs = 1", r"expected a table of a verb, found \[tarin\]"),
        ("[golden.ad]\ncases = 'x'", r"expected a table of a verb, found \[golden.ad\]"),
        ("overwrite = true", "no verb has an option overwrite that a file sets"),
        ("[train]\nout = 'x.npz'", "no option out of this verb"),
        ("connect = 'tcp/127.0.0.1:9999'", "connect: expected a list, found"),
        ("[train]\nepochs = [1]", "epochs: expected a value, found"),
        ("[learn]\nlive = 1", "live: expected true or false, found 1"),
        ("robot = ", "expected TOML"),
    ],
)
def test_what_cannot_be_meant_is_one_line_with_the_file(tmp_path: Path, text: str, expected: str) -> None:
    with pytest.raises(ConfigError, match=expected) as error:
        defaults(tmp_path, text)
    assert str(error.value).startswith(f"{tmp_path / 'reenact.toml'}: ")


def test_a_folder_of_that_name_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "reenact.toml").mkdir()
    with pytest.raises(ConfigError, match="expected a TOML file, found a directory"):
        find_settings(tmp_path)


def test_a_setting_that_a_command_has_no_use_for_is_no_error_and_the_same_on_the_command_line_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A project's robot and rates are for the commands that take them; who asks for one here gets told."""
    write_episode(tmp_path / "log.mcap", samples=3)
    (tmp_path / "reenact.toml").write_text('robot = "asimo"\ntick-rate = 10\nrule = "reservoir"\n')
    monkeypatch.chdir(tmp_path)
    given = CliRunner().invoke(app, ["train", "log.mcap", "--out", "a.npz", "--as-recorded", "--tick-rate", "5"])
    assert isinstance(given.exception, ConfigError)
    of_file = CliRunner().invoke(app, ["train", "log.mcap", "--out", "a.npz", "--as-recorded"])
    assert "--tick-rate" not in str(of_file.exception)
    (tmp_path / "reenact.toml").write_text('robot = "asimo"\n')
    assert CliRunner().invoke(app, ["convert", "log.mcap", "--out", "b.mcap"]).exit_code == 0
    assert CliRunner().invoke(app, ["convert", "log.mcap", "--out", "c.mcap", "--robot", "asimo"]).exit_code != 0


def test_the_settings_of_one_command_are_none_of_the_next(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In one process, such as that of tests, in folders with and without a file."""
    (tmp_path / "with").mkdir()
    (tmp_path / "without").mkdir()
    (tmp_path / "with" / "reenact.toml").write_text('map = ["/a=/b"]\n')
    monkeypatch.chdir(tmp_path / "with")
    CliRunner().invoke(app, ["info", "nowhere.mcap"])
    assert of_settings("map")
    monkeypatch.chdir(tmp_path / "without")
    CliRunner().invoke(app, ["info", "nowhere.mcap"])
    assert not of_settings("map")


def test_names_of_topics_that_a_log_lacks_count_for_nothing_if_settings_have_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A line comes only if nothing matched; on the command line such a name is a slip of the pen."""
    write_episode(tmp_path / "log.mcap", samples=3)
    renamed = "/sample/joint_states=/joint_states"
    monkeypatch.chdir(tmp_path)
    for number, (names, left, noted) in enumerate(
        (
            ('"/tracker=/hand/left/measured"', "/sample/joint_states", True),
            (f'"/tracker=/hand/left/measured", "{renamed}"', "/joint_states", False),
        )
    ):
        (tmp_path / "reenact.toml").write_text(f"map = [{names}]\nlatency = []\n")
        made = CliRunner().invoke(app, ["convert", "log.mcap", "--out", f"{number}.mcap"])
        assert made.exit_code == 0, made.exception
        assert left in LogReader(tmp_path / f"{number}.mcap").topics
        assert ("no log has a topic of the settings' map, /tracker" in capsys.readouterr().err + made.output) == noted
    given = CliRunner().invoke(app, ["convert", "log.mcap", "--out", "c.mcap", "--map", "/tracker=/hand/left/measured"])
    assert isinstance(given.exception, ConfigError)
