"""Groups of options: each field is an option of its own, in the place of the group."""

import inspect
from dataclasses import dataclass
from typing import Annotated

import pytest
import typer
from typer.testing import CliRunner

from pipeline.cli.groups import grouped


@dataclass(frozen=True)
class Pace:
    rate: Annotated[float, typer.Option(help="Ticks a second.")] = 10.0
    paced: bool = False


@grouped
def verb(name: str, *, pace: Pace, count: int = 1) -> None:
    """Do it."""
    print(name, pace, count)


def test_fields_take_the_place_of_their_group() -> None:
    assert list(inspect.signature(verb).parameters) == ["name", "rate", "paced", "count"]
    assert (verb.__name__, verb.__doc__) == ("verb", "Do it.")


def test_options_are_put_together_and_keep_their_defaults() -> None:
    app = typer.Typer()
    app.command()(verb)
    run = CliRunner().invoke(app, ["x", "--rate", "2.5"])
    assert run.output == "x Pace(rate=2.5, paced=False) 1\n"
    run = CliRunner().invoke(app, ["x", "--paced", "--count", "3"])
    assert run.output == "x Pace(rate=10.0, paced=True) 3\n"


def test_called_by_hand_it_takes_the_fields(capsys: pytest.CaptureFixture[str]) -> None:
    verb("x", rate=1.0)
    assert capsys.readouterr().out == "x Pace(rate=1.0, paced=False) 1\n"
