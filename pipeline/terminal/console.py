"""Output of the command line: progress on the terminal, results as a table or as JSON."""

import io
import json
import os
import shutil
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import (
    BarColumn,
    Progress,
    TaskProgressColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.table import Table

from pipeline.terminal.escaping import wrapped
from recorders.text.quantities import decimal_text
from recorders.text.wording import escape_control


class _Lines(Console):
    """Standard error, whose reader may go away: rich would end the program then."""

    def on_broken_pipe(self) -> None:
        """Print nothing more."""
        self.quiet = True
        os.dup2(os.open(os.devnull, os.O_WRONLY), self.file.fileno())


errors = _Lines(stderr=True, highlight=False, soft_wrap=True)


@contextmanager
def progress(description: str) -> Iterator[Callable[[float], None]]:
    """Show a bar on standard error while the block runs, and nothing where there is no terminal.

    Yields
    ------
    callable
        Takes the fraction done, from 0 to 1.
    """
    description_column = TextColumn("{task.description:<32}", markup=False)
    columns = (description_column, BarColumn(), TaskProgressColumn(), TimeRemainingColumn())
    with Progress(*columns, console=errors, disable=not sys.stderr.isatty()) as bar:
        task = bar.add_task(description, total=1.0)
        yield lambda fraction: bar.update(task, completed=fraction)


@contextmanager
def counter(description: str) -> Iterator[Callable[[int, int], None]]:
    """Show messages, bytes and the rate on standard error while the block runs, and nothing without a terminal.

    Yields
    ------
    callable
        Takes messages and bytes so far.
    """
    text = TextColumn(
        "{task.description}  {task.completed:.0f} messages  {task.fields[megabytes]:.1f} MB", markup=False
    )
    with Progress(text, TimeElapsedColumn(), console=errors, disable=not sys.stderr.isatty()) as bar:
        task = bar.add_task(description, total=None, megabytes=0.0)
        yield lambda messages, size: bar.update(task, completed=messages, megabytes=size / 1e6)


def take_any_text() -> None:
    """Have both streams take whatever is printed: spelt out where their encoding has no such letter, or dropped.

    A stream that was closed by whoever started the program takes nothing: its number is that of no other file then.
    """
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:
            setattr(sys, name, Path(os.devnull).open("w", encoding="utf-8"))  # noqa: SIM115  # as long as the program
        elif isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def notice(text: str) -> None:
    """Print one line for the reader, on standard error, so that standard output holds the result alone.

    A reader who has gone, or a terminal that was closed, ends no work.
    """
    with suppress(OSError):
        errors.print(escape_control(text), markup=False)


def line(text: str) -> None:
    """Print one line of a result."""
    block(escape_control(text))


def block(text: str) -> bool:
    """Print lines of our own; a reader who has gone away (`| head`) is no failure of ours: False then."""
    try:
        print(text, flush=True)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return False
    return True


def show(result: Mapping[str, Any], *, as_json: bool) -> None:
    """Print a result: one JSON object, or a line for each entry that there is something to say of."""
    if as_json:
        block(json.dumps(result, allow_nan=False))
        return
    lines = {name: value for name, value in _flat(result) if value not in ([], (), "")}
    width = max(map(len, lines))
    for name, value in lines.items():
        line(f"{name:<{width}}  {_text(value)}")


def width() -> int:
    """Return how many columns the terminal has; 80 where there is none."""
    return shutil.get_terminal_size().columns


def entries(texts: Mapping[str, str]) -> None:
    """Print texts by name, each within the columns that there are: beside its name, or below it where these are few."""
    columns, lines = width(), list[str]()
    named = min(max(map(len, texts)), columns // 3)
    for name, text in texts.items():
        beside = len(name) <= named
        if not beside:
            lines += wrapped(escape_control(name), columns)
        begin, hanging = f"{name if beside else '':<{named}}  ", " " * (named + 2)
        lines += wrapped(escape_control(text), columns, indent=begin, hanging=hanging)
    block("\n".join(lines))


def table(content: Table) -> bool:
    """Print a table, as wide as it needs to be where there is no terminal; False if its reader has gone away."""
    console = Console(highlight=False, width=None if sys.stdout.isatty() else 120)
    with console.capture() as captured:
        console.print(content)
    return block(captured.get().rstrip("\n"))


def _flat(result: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the entries of a result; those of a result within it, such as each consumer's, by both names."""
    for name, value in result.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{prefix}{name}: " if prefix or name != "consumers" else "")
        else:
            yield prefix + name, value


def _text(value: Any) -> str:
    """Return a value as a reader writes it, with nothing of Python's in it."""
    if value is None:
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, Sequence) and not isinstance(value, str):
        return ", ".join(map(_text, value))
    return decimal_text(value) if isinstance(value, float) else str(value)
