"""Making a golden case: its logs cut down, run once, and stored with everything that the run came to."""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

from recorders.errors import ConfigError, LogError, ReenactError
from recorders.files import disk
from recorders.files.new_folder import new_folder, sync_folders
from recorders.mcap_format.manifest import environment
from recorders.text.wording import names_text
from replay.golden.case import (
    STATES_FILE,
    STEPS_FILE,
    Case,
    Tolerances,
    check_name,
    index_file,
    load_case,
    own_files,
)
from replay.golden.check import check_case
from replay.golden.finding import PHYSICS
from replay.golden.folder import CASE_FILE, roll_back, swap_in
from replay.golden.learning_tier import truncated_digests
from replay.golden.log_tier import LogIndex, describe, strip_topics
from replay.golden.recipe import MAX_CASE_BYTES, CaseSpec, EpochEnd, Runner
from replay.sources.scheduled import Replay

Progress = Callable[[float], None]


def add_case(
    folder: Path,
    recipe: CaseSpec,
    runner: Runner,
    *,
    reason: str | None = None,
    progress: Progress = lambda fraction: None,
) -> Case:
    """Make a case, or make one anew; that it holds is checked before it takes its place.

    Parameters
    ----------
    folder : Path
        Where it goes; its name is that of the case.
    recipe : CaseSpec
        What is to be run, with the logs wherever they lie; the case gets copies.
    runner : Runner
        Runs it.
    reason : str, optional
        Why; needed if the case exists, and stored in its history with what changes of the recipe. Tolerances stay.
    progress : callable
        Called with the fraction done, from 0 to 1.

    Returns
    -------
    Case

    Raises
    ------
    ConfigError
        If a name cannot be used, the case exists and there is no reason or its folder holds other files, the case
        would be too large, or it does not hold.
    ReenactError
        If a log cannot be read, or the run fails.
    """
    check_name(folder.name)
    roll_back(folder)
    before = _before(folder, reason)
    with _in_place_of(folder) as new:
        try:
            _check(_make(new, recipe, runner, before=before, reason=reason, progress=progress), runner)
        except ReenactError as error:
            raise type(error)(_as_given(str(error), new, recipe.logs)) from error
    progress(1.0)
    return load_case(folder)


@contextmanager
def _in_place_of(folder: Path) -> Iterator[Path]:
    """Make a folder that takes the place of a case when the block ends; LogError is raised if it cannot be written."""
    try:
        disk.make_folders(folder.parent)
        with new_folder(folder) as new:
            yield new
            sync_folders(new)
            swap_in(new, folder)
    except OSError as error:
        raise LogError(f"cannot write {folder}: {error.strerror or error}") from error


def _as_given(line: str, new: Path, logs: Sequence[Path]) -> str:
    """Return an error line with the logs as they were given, in place of their copies, which are gone by then."""
    for log in logs:
        line = line.replace(str(new / log.name), str(log))
    return line


def _before(folder: Path, reason: str | None) -> Case | None:
    """Return the case that is to be replaced; what is not its own is not thrown away with it."""
    if not folder.exists():
        return None
    if not (reason or "").strip():
        raise ConfigError(f"{folder} exists: give with --reason why its expectations change")
    case = load_case(folder)
    strangers = sorted({path.name for path in folder.iterdir()} - set(case.file_names))
    if strangers:
        raise ConfigError(f"{folder}: expected the files of the case alone, found {strangers[0]!r:.60}; move it away")
    return case


def _make(
    folder: Path, recipe: CaseSpec, runner: Runner, *, before: Case | None, reason: str | None, progress: Progress
) -> Case:
    stored = replace(recipe, logs=_copies(recipe, folder))
    _check_size(folder)
    source = stored.source()
    episodes = source.episodes if isinstance(source, Replay) else ()
    digests = [episode.digest for episode in episodes] or [""]
    logs = tuple(describe(path, ticks_sha256=digest) for path, digest in zip(stored.logs, digests, strict=True))
    steps, states = _run(stored, runner, progress)
    files = {STEPS_FILE: steps, STATES_FILE: states}
    files |= {index_file(path.name): LogIndex(stored.schedule.topics).of(path) for path in stored.logs}
    case = Case(
        folder=folder,
        recipe=stored,
        logs=logs,
        expected={"run": source.run, **runner.train(stored)},
        tolerances=Tolerances() if before is None else before.tolerances,
        environment=environment(),
    )
    new = replace(case, history=_history(case, before, reason)).save(files)
    progress(0.7)
    return new


def _run(recipe: CaseSpec, runner: Runner, progress: Progress) -> tuple[bytes, bytes]:
    steps, states = bytearray(), []
    for event in runner.learn(recipe):
        if isinstance(event, EpochEnd):
            states.append(event.state)
            progress(0.5 * len(states) / recipe.schedule.epochs)  # the rest trains once more, and checks the case
        else:
            steps += truncated_digests(event)
    return bytes(steps), runner.pack(states)


def _copies(recipe: CaseSpec, folder: Path) -> tuple[Path, ...]:
    names = [check_name(log.name) for log in recipe.logs]
    taken = [*names, CASE_FILE, *own_files(names)]
    if len(set(taken)) != len(taken):
        raise ConfigError(
            f"expected logs of different names, none of them {CASE_FILE}, {STEPS_FILE}, {STATES_FILE} or LOG.index, "
            f"found {names_text(names)}"
        )
    copies = tuple(folder / name for name in names)
    for source, target in zip(recipe.logs, copies, strict=True):
        strip_topics(source, target, physics=recipe.physics, tick=recipe.schedule.topics, file_order=recipe.as_recorded)
    return copies


def _history(case: Case, before: Case | None, reason: str | None) -> tuple[Mapping[str, Any], ...]:
    entry: dict[str, Any] = {"reason": (reason or "").strip(), "digest": case.expected["digest"]}
    if before is None:
        return ({**entry, "reason": entry["reason"] or "the first of this name"},)
    old, new = _asked(before), _asked(case)
    changes = [
        f"{name}: {old.get(name)} -> {new.get(name)}" for name in {**old, **new} if old.get(name) != new.get(name)
    ]
    return (*before.history, {**entry, "changed": changes} if changes else entry)


def _asked(case: Case) -> dict[str, str]:
    """Return what a case runs and checks, for its history: the settings, and each log by name and hash."""
    recipe = case.recipe
    asked = {
        "logs": [f"{log.name} {log.sha256[:16]}" for log in case.logs],
        "schedule": recipe.schedule.to_dict(),
        "as_recorded": recipe.as_recorded,
        "resume_after": recipe.resume_after,
        "physics": recipe.physics,
        **{f"learner {name}": value for name, value in recipe.learner.items()},
    }
    return {name: json.dumps(value) for name, value in asked.items()}


def _check_size(folder: Path) -> None:
    sizes = {path.name: path.stat().st_size for path in folder.iterdir()}
    total = sum(sizes.values())
    if total > MAX_CASE_BYTES:
        parts = ", ".join(f"{name} {size}" for name, size in sorted(sizes.items(), key=lambda item: -item[1])[:3])
        raise ConfigError(
            f"golden case: expected at most {MAX_CASE_BYTES} bytes, found {total} ({parts}); take fewer epochs, "
            "fewer neurons or a shorter log"
        )


def _check(case: Case, runner: Runner) -> None:
    _check_size(case.folder)
    finding = check_case(case.folder, runner).finding
    if finding is not None and finding.tier == PHYSICS:
        raise ConfigError(f"the simulation does not make this log again; leave --physics out: {finding}")
    if finding is not None:
        raise ConfigError(f"the case does not hold as soon as it is written: {finding}")
