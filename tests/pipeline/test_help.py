"""The help: whole lines, names for what an option takes, defaults, and an example of the verb's own first."""

import importlib.metadata
import re

import pytest

from pipeline import cli

VERBS = ("demo", "explore", "demonstrate", "robot", "record", "train", "learn", "replay", "serve", "evaluate", "diff")
VERBS += ("info", "recover", "paper", "view", "golden add", "golden check")


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


@pytest.mark.parametrize("verb", VERBS)
def test_the_first_example_is_of_the_verb_itself(verb: str, capsys: pytest.CaptureFixture[str]) -> None:
    shown = " ".join(printed(f"{verb} --help", capsys).split())
    assert re.search(r"Example[^:]*: (reenact [^-]*)", shown)[1].startswith(f"reenact {verb} ".rstrip())  # type: ignore[index]


@pytest.mark.parametrize("verb", VERBS)
def test_options_say_what_they_take(verb: str, capsys: pytest.CaptureFixture[str]) -> None:
    options = printed(f"{verb} --help", capsys).partition("Options:")[2]
    assert "<" not in options


@pytest.mark.parametrize("verb", ["demonstrate", "robot", "record", "learn", "replay", "serve"])
def test_the_endpoint_that_is_taken_by_default_is_said(verb: str, capsys: pytest.CaptureFixture[str]) -> None:
    shown = " ".join(printed(f"{verb} --help", capsys).split())
    own, other = ("connect to", "--listen") if verb in ("record", "replay") else ("listen on", "--connect")
    assert f"Endpoint to {own}; tcp/127.0.0.1:7447 unless {other} is given" in shown


def test_the_version(capsys: pytest.CaptureFixture[str]) -> None:
    assert printed("--version", capsys) == f"reenact {importlib.metadata.version('reenact')}\n"
