"""Progress of a learner on the terminal: its ticks, and the share of its stream where that has a known length."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

from pipeline.terminal.console import errors


@contextmanager
def learning_progress(description: str) -> Iterator[Callable[[int, float | None], None]]:
    """Show ticks and share on standard error while the block runs, and nothing where there is no terminal.

    Yields
    ------
    callable
        Takes the ticks so far and the share of the stream that is through, from 0 to 1, or None where its length is
        not known.
    """
    text = TextColumn("{task.description}  {task.fields[ticks]} ticks", markup=False)
    columns = (SpinnerColumn(), text, BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=errors, disable=not sys.stderr.isatty()) as shown:
        task = shown.add_task(description, total=None, ticks=0)

        def show(ticks: int, share: float | None) -> None:
            """Show ticks and share."""
            if share is None:
                shown.update(task, ticks=ticks)
            else:
                shown.update(task, ticks=ticks, total=1.0, completed=share)

        yield show
