"""Making a golden case: its logs cut down, run once, and kept with everything that the run came to."""

import shutil
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from recorders.errors import ConfigError, LogError
from recorders.manifest import environment
from replay.engine import Replay
from replay.golden_case import STATES_FILE, STEPS_FILE, Case, check_name, index_file, load_case
from replay.golden_learning import short
from replay.golden_log import describe, index, slim
from replay.golden_physics import check_physics
from replay.golden_recipe import EpochEnd, Recipe, Runner

MAX_CASE_BYTES = 300_000
"""A case lies beside the code that it guards."""


def add_case(folder: Path, recipe: Recipe, runner: Runner, *, reason: str | None = None) -> Case:
    """Make a case, or make one anew.

    Parameters
    ----------
    folder : Path
        Where it goes; its name is that of the case.
    recipe : Recipe
        What is to be run, with the logs wherever they lie; the case gets copies.
    runner : Runner
        Runs it.
    reason : str, optional
        Why; needed if the case exists, and kept in its history.

    Returns
    -------
    Case

    Raises
    ------
    ConfigError
        If the name is none, the case exists and there is no reason, or it would be too large.
    ReenactError
        If a log cannot be read, or the run fails.
    """
    check_name(folder.name)
    history = _history(folder, reason)
    folder.parent.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory(dir=folder.parent, prefix=f".{folder.name}.") as temporary:
        made = Path(temporary, folder.name)
        made.mkdir()
        case = _make(made, recipe, runner, history=history, reason=reason)
        _check_size(case)
        _put(made, folder)
    return load_case(folder)


def _make(
    folder: Path, recipe: Recipe, runner: Runner, *, history: tuple[Mapping[str, Any], ...], reason: str | None
) -> Case:
    kept = replace(recipe, logs=_copies(recipe, folder))
    source = kept.source()
    episodes = source.episodes if isinstance(source, Replay) else ()
    digests = [episode.digest for episode in episodes] or [""]
    logs = tuple(describe(path, ticks_sha256=digest) for path, digest in zip(kept.logs, digests, strict=True))
    steps, states = _run(kept, runner)
    expected = {"run": source.run, **runner.train(kept)}
    entry = {"reason": reason or "the first of this name", "digest": expected["digest"]}
    files = {STEPS_FILE: steps, STATES_FILE: states}
    files |= {index_file(path.name): index(path) for path in kept.logs}
    case = Case(
        folder=folder,
        recipe=kept,
        logs=logs,
        expected=expected,
        environment=environment(),
        history=(*history, entry),
    ).save(files)
    finding = check_physics(case, runner)
    if finding is not None:
        raise ConfigError(f"the simulation does not make this log again; leave --physics out: {finding}")
    return case


def _run(recipe: Recipe, runner: Runner) -> tuple[bytes, bytes]:
    steps, states = bytearray(), []
    for event in runner.learn(recipe):
        if isinstance(event, EpochEnd):
            states.append(event.state)
        else:
            steps += short(event)
    return bytes(steps), runner.pack(states)


def _copies(recipe: Recipe, folder: Path) -> tuple[Path, ...]:
    copies = tuple(folder / check_name(log.name) for log in recipe.logs)
    if len(set(copies)) != len(copies):
        raise ConfigError(f"expected logs of different names, found {', '.join(log.name for log in recipe.logs)}")
    for source, target in zip(recipe.logs, copies, strict=True):
        slim(source, target, physics=recipe.physics)
    return copies


def _history(folder: Path, reason: str | None) -> tuple[Mapping[str, Any], ...]:
    if not folder.exists():
        return ()
    if not reason:
        raise ConfigError(f"{folder} exists: say with --reason why its expectations change")
    return load_case(folder).history


def _check_size(case: Case) -> None:
    sizes = {path.name: path.stat().st_size for path in case.folder.iterdir()}
    total = sum(sizes.values())
    if total > MAX_CASE_BYTES:
        parts = ", ".join(f"{name} {size}" for name, size in sorted(sizes.items(), key=lambda item: -item[1])[:3])
        raise ConfigError(
            f"golden case: expected at most {MAX_CASE_BYTES} bytes, found {total} ({parts}); take fewer epochs, "
            "fewer neurons or a shorter log"
        )


def _put(made: Path, folder: Path) -> None:
    """Put a new case in the place of the old; a crash leaves either, or the old one beside it."""
    try:
        old = made.with_name("old")
        if folder.exists():
            folder.rename(old)
        made.rename(folder)
        shutil.rmtree(old, ignore_errors=True)
    except OSError as error:
        raise LogError(f"cannot write {folder}: {error.strerror or error}") from error
