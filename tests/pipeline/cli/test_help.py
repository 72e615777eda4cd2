"""The help: whole lines, names for what an option takes, defaults, and an example of the verb's own first."""

import importlib.metadata
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from typing import Any

import pytest
import typer

from pipeline.cli import app as cli
from pipeline.motions.motion import load_motion
from pipeline.motions.names import drawings, motion_names
from pipeline.robot.config import load_robot

# Python's own words, which are nothing to whoever reads a help or a line.
PYTHON = re.compile(r"<\w+|\b(None|True|False|str|bool|dict|tuple|Path|INTEGER|FLOAT)\b|\[\]|inf\b|\w+\(\)")


def commands(group: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Yield every verb of the program with its command, whoever adds one."""
    for name, command in group.commands.items():
        if hasattr(command, "commands"):
            yield from commands(command, f"{path}{name} ")
        if command.params or not hasattr(command, "commands"):
            yield path + name, command


COMMANDS = dict(commands(typer.main.get_command(cli.app)))  # those of a group before the group
VERBS = list(COMMANDS)


def printed(line: str, capsys: pytest.CaptureFixture[str], *, status: int = 0) -> str:
    with pytest.raises(SystemExit) as end:
        cli.main(line.split())
    assert end.value.code == status
    found = capsys.readouterr()
    assert found.err == ""
    return found.out


@pytest.mark.parametrize(("line", "verbs"), [("", ("demo", "golden")), ("golden", ("add", "check"))])
def test_without_a_verb_it_is_the_help_and_bad_usage(
    line: str, verbs: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    bare = printed(line, capsys, status=2)
    assert bare == printed(f"{line} --help", capsys)
    assert all(re.search(rf"^  {verb} +\S", bare, re.MULTILINE) for verb in verbs)


@pytest.mark.parametrize("line", ["--help", "golden --help"])
def test_no_line_is_cut(line: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert "..." not in printed(line, capsys).replace("[ARGS]...", "")


@pytest.mark.parametrize("verb", ["", "golden", *VERBS])
def test_every_help_fits_80_columns_and_has_an_example(verb: str, capsys: pytest.CaptureFixture[str]) -> None:
    lines = printed(f"{verb} --help", capsys).splitlines()
    assert [line for line in lines if len(line) > 80] == []
    assert any(line.startswith("  Example: reenact ") for line in lines)


@pytest.mark.parametrize("verb", VERBS)
def test_the_first_example_is_of_the_verb_itself(verb: str, capsys: pytest.CaptureFixture[str]) -> None:
    shown = " ".join(printed(f"{verb} --help", capsys).split())
    assert re.search(r"Example[^:]*: (reenact [^-]*)", shown)[1].startswith(f"reenact {verb} ".rstrip())  # type: ignore[index]


@pytest.mark.parametrize("verb", VERBS)
def test_each_argument_and_option_says_in_plain_words_what_it_takes(verb: str) -> None:
    for param in COMMANDS[verb].params:
        assert param.help, f"{verb}: {param.name} has no help"
        if not getattr(param, "is_flag", False):
            assert re.fullmatch(r"[A-Za-z][A-Za-z0-9.|,=]*", param.metavar or ""), (
                f"{verb}: {param.name}: {param.metavar}"
            )


@pytest.mark.parametrize("verb", ["", "golden", *VERBS])
def test_the_help_has_nothing_of_pythons_and_h_asks_for_it_too(verb: str, capsys: pytest.CaptureFixture[str]) -> None:
    shown = printed(f"{verb} --help", capsys)
    assert PYTHON.findall(shown) == []
    assert printed(f"{verb} -h", capsys) == shown


@pytest.mark.parametrize("verb", VERBS)
def test_the_examples_are_commands_that_exist(verb: str) -> None:
    examples = re.findall(r": (reenact [^\n]+)", COMMANDS[verb].epilog)
    assert examples
    for example in examples:
        words = shlex.split(example)[1:]
        named = next(name for name in COMMANDS if words[: len(name.split())] == name.split())
        rest = words[len(named.split()) :]
        COMMANDS[named].make_context(named, rest, resilient_parsing=False).close()


@pytest.mark.parametrize("verb", ["explore", "evaluate", "view"])
def test_the_help_names_every_motion_that_comes_with_the_program(verb: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert len(drawings()) >= 3
    assert ", ".join(motion_names()) in " ".join(printed(f"{verb} --help", capsys).split())
    assert [load_motion(name, load_robot("asimo")).name for name in motion_names()] == motion_names()


def test_the_help_of_demonstrate_names_every_drawing(capsys: pytest.CaptureFixture[str]) -> None:
    assert ", ".join(drawings()) in " ".join(printed("demonstrate --help", capsys).split())


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("train", "missing argument 'LOG.mcap' (`reenact train --help` shows what there is)"),
        ("golden add", "missing option '--name' (`reenact golden add --help` shows what there is)"),
        ("trian", "no such command 'trian'. Did you mean 'train'? (`reenact --help` shows what there is)"),
        (
            "golden chekc",
            "no such command 'chekc'. Did you mean 'check'? (`reenact golden --help` shows",
        ),
        ("train --otu", "no such option --otu; did you mean --out? (`reenact train --help` shows what there is)"),
        ("train -o x", "no such option -o; did you mean --out? (`reenact train --help` shows what there is)"),
        ("--verison", "no such option --verison; did you mean --version? (`reenact --help` shows what there is)"),
        ("train x --epochs few", "--epochs: expected a whole number, at least 1, found 'few' (`reenact train --help`"),
        ("explore --wait nan", "--wait: expected a number, at least 0, found 'nan' (`reenact explore --help`"),
    ],
)
def test_what_was_typed_wrongly_is_one_line_that_names_the_verbs_help(
    line: str, expected: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as end:
        cli.main(line.split())
    assert end.value.code == 2
    found = capsys.readouterr()
    assert found.out == ""
    assert found.err.startswith(f"reenact: {expected}")
    assert found.err.count("\n") == 1


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("reenact trai", ["train"]),
        ("reenact golden ", ["add", "check"]),
        ("reenact train --see", ["--seed"]),
        ("reenact explore --motion right", sorted(drawings())),
        ("reenact explore --robot g", ["g1"]),
    ],
)
def test_the_shell_completes_verbs_options_and_names(
    words: str, expected: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("_REENACT_COMPLETE", "complete_bash")
    monkeypatch.setenv("COMP_WORDS", words)
    monkeypatch.setenv("COMP_CWORD", str(words.count(" ")))
    assert printed("", capsys).splitlines() == expected


def test_completion_is_installed_and_loads_nothing_heavy() -> None:
    heavy = "numpy", "numba", "zenoh", "rerun", "pydrake", "pinocchio", "matplotlib", "rosbags"
    script = (
        "import atexit, sys\n"
        f"atexit.register(lambda: print(sorted(set({heavy!r}) & set(sys.modules))))\n"
        "from pipeline.cli import app\napp.main(['--show-completion'])"
    )
    run = subprocess.run(["bash", "-c", f'"$0" -c "{script}"; true', sys.executable], capture_output=True, text=True)
    assert "_REENACT_COMPLETE=complete_bash" in run.stdout
    assert run.stdout.splitlines()[-1] == "[]", run.stderr


@pytest.mark.parametrize("verb", ["demonstrate", "robot", "record", "learn", "replay", "serve"])
def test_the_endpoint_that_is_taken_by_default_is_said(verb: str, capsys: pytest.CaptureFixture[str]) -> None:
    shown = " ".join(printed(f"{verb} --help", capsys).split())
    own, other = ("connect to", "--listen") if verb in ("record", "replay") else ("listen on", "--connect")
    assert f"Endpoint to {own}; tcp/127.0.0.1:7447 unless {other} is given" in shown


def test_the_version(capsys: pytest.CaptureFixture[str]) -> None:
    assert printed("--version", capsys) == f"reenact {importlib.metadata.version('reenact-robot')}\n"
