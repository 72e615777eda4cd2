"""Options under their former names: they do the same as under the present ones, with a line that names those."""

from typing import Any

import pytest
import typer

from pipeline.cli import app as cli
from pipeline.cli.renamed_options import RENAMED_OPTIONS

RENAMED = [(verb, old, new) for verb, names in RENAMED_OPTIONS.items() for old, new in names.items()]
REQUIRED = {
    "demonstrate": ["live", "--out", "shown.mcap"],
    "golden add": ["--name", "case"],
    "learn": ["--out", "controller.npz"],
    "record": [],
    "replay": ["log.mcap"],
    "serve": ["controller.npz"],
}


def parsed(verb: str, arguments: list[str]) -> dict[str, Any]:
    """Return the values of a verb's options and arguments, as the command line gives them to it."""
    command: Any = typer.main.get_command(cli.app)
    words = [*verb.split(), *arguments]
    context = command.make_context("reenact", list(words))
    for name in verb.split():
        command = command.commands[name]
        words = words[1:]
        context = command.make_context(name, list(words), parent=context)
    return dict(context.params)


def takes_value(verb: str, option: str) -> bool:
    command: Any = typer.main.get_command(cli.app)
    for name in verb.split():
        command = command.commands[name]
    return not next(param.is_flag for param in command.params if f"--{option}" in param.opts)


@pytest.mark.parametrize(("verb", "old", "new"), RENAMED)
def test_a_former_name_does_the_same_and_names_the_present_one(
    verb: str, old: str, new: str, capsys: pytest.CaptureFixture[str]
) -> None:
    forms = [["--{}", "5"], ["--{}=5"]] if takes_value(verb, new) else [["--{}"]]
    for form in forms:
        expected = parsed(verb, REQUIRED[verb] + [word.format(new) for word in form])
        assert expected != parsed(verb, REQUIRED[verb])
        assert capsys.readouterr().err == ""
        assert parsed(verb, REQUIRED[verb] + [word.format(old) for word in form]) == expected
        assert capsys.readouterr().err == f"--{old} is now called --{new}\n"


@pytest.mark.parametrize(("verb", "old", "new"), RENAMED)
def test_the_help_has_the_present_name_alone(verb: str, old: str, new: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        cli.main([*verb.split(), "--help"])
    words = capsys.readouterr().out.split()
    assert f"--{new}" in words
    assert f"--{old}" not in words


def test_what_is_no_option_is_left_as_it_is(capsys: pytest.CaptureFixture[str]) -> None:
    assert parsed("golden add", ["--name", "--dir", "--", "--dir"])["name"] == "--dir"
    assert [str(log) for log in parsed("replay", ["log.mcap", "--", "--batch"])["logs"]] == ["log.mcap", "--batch"]
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("line", ["train log.mcap --every 5", "record --batch 5", "golden check --dir cases"])
def test_a_verb_that_never_had_the_name_refuses_it(line: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as end:
        cli.main(line.split())
    assert end.value.code == 2
    printed = capsys.readouterr().err
    assert printed.startswith(f"reenact: no such option {line.split()[-2]}")
    assert printed.count("\n") == 1
