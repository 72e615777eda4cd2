"""The mutation gate: every mutant of a module is noticed by the module's tests, or known to change nothing.

    python tests/mutation/campaign.py [MODULE ...] [--sample N] [--seed S] [--again] [--out NAME]

Exit status 1 if a mutant survives that `equivalent.toml` does not name, or an entry there names none; 2 if nothing
could be run.
Results stand in out/mutants/NAME/MODULE.json; `--again` runs those that survived the last time.
"""

import argparse
import json
import os
import sys
import traceback
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1] / "support"))

from mutant_session import ROOT
from mutant_table import MutatedModule, change_text, drawn, equivalents, line_text, mutated_modules, stale
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table


def main() -> int:
    """Run the campaign; return the exit status."""
    options = _options()
    console = Console(file=os.fdopen(os.dup(1), "w"), soft_wrap=True, highlight=False)
    table = {module.name: module for module in mutated_modules()}
    unknown = [name for name in options.modules if name not in table]
    if unknown:
        console.print(f"MODULE: expected one of {', '.join(table)}, found {', '.join(unknown)}")
        return 2
    old = stale(equivalents(), list(table.values()))
    for entry in old:
        console.print(f"equivalent.toml: names no mutant, or has no reason: {entry}", markup=False)
    results = [_in_own_process(table[name], options) for name in options.modules or table]
    for result in results:
        _print_survivors(console, result)
    console.print(_summary(results))
    if any(result.get("error") for result in results):
        return 2
    return 1 if old or any(_survivors(result) for result in results) else 0


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("modules", nargs="*", metavar="MODULE", help="rows of modules.toml; without one, all")
    parser.add_argument("--sample", type=int, metavar="N", help="so many mutants of each module, drawn by seed")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--again", action="store_true", help="those that survived the last time")
    parser.add_argument("--out", type=(ROOT / "out" / "mutants").joinpath, default=ROOT / "out" / "mutants" / "last")
    parser.add_argument("--processes", type=int, default=os.cpu_count() or 1)
    return parser.parse_args()


def _in_own_process(module: MutatedModule, options: argparse.Namespace) -> dict[str, Any]:
    """Run a module's mutants in a fork: what one module's tests import, and how, concerns no other."""
    file = options.out / f"{module.name}.json"
    file.parent.mkdir(parents=True, exist_ok=True)
    before = json.loads(file.read_text())["outcomes"] if options.again else None
    process = os.fork()
    if process == 0:
        status = 1
        try:
            file.write_text(json.dumps(_run(module, options, before), indent=1))
            status = 0
        except BaseException:
            traceback.print_exc()
        finally:
            sys.stderr.flush()
            os._exit(status)
    _, status = os.waitpid(process, 0)
    if status:
        return {"module": module.name, "error": f"ended with status {status}", "outcomes": []}
    found: dict[str, Any] = json.loads(file.read_text())
    return found


def _run(module: MutatedModule, options: argparse.Namespace, before: list[dict[str, str]] | None) -> dict[str, Any]:
    if module.interpreted:
        os.environ["NUMBA_DISABLE_JIT"] = "1"
    import pytest
    from hypothesis import HealthCheck, Phase, settings
    from mutant_session import OPTIONS, MutantSession, Outcome

    # Each mutant meets the same examples, none from another's failure, and no time goes into making one small.
    settings.register_profile(
        "mutants",
        derandomize=True,
        deadline=None,
        database=None,
        phases=(Phase.explicit, Phase.generate),
        suppress_health_check=[HealthCheck.too_slow],
    )
    settings.load_profile("mutants")
    known = equivalents()
    jobs = module.jobs()
    entries = [next((entry for entry in known if entry.names(job)), None) for job in jobs]
    to_run = [job for job, entry in zip(jobs, entries, strict=True) if entry is None]
    to_run = drawn(to_run, sample=options.sample, seed=options.seed)
    if before is not None:
        again = {(row["file"], row["line"], row["change"]) for row in before if row["result"] != "killed"}
        to_run = [job for job in to_run if (job.file, line_text(job), change_text(job.mutant)) in again]
    outcomes: list[Outcome] = []
    columns = TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn()
    with Progress(*columns, console=Console(file=os.fdopen(os.dup(2), "w"))) as progress:
        task = progress.add_task(module.name, total=len(to_run))

        def finished(outcome: Outcome) -> None:
            outcomes.append(outcome)
            progress.advance(task)

        session = MutantSession(to_run, processes=options.processes, finished=finished)
        log = os.open(options.out / f"{module.name}.log", os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        os.dup2(log, 1)
        os.dup2(log, 2)
        os.chdir(ROOT)
        pytest.main(["-m", "not campaign", *OPTIONS, *module.tests], plugins=[session])
    order = {job: place for place, job in enumerate(to_run)}
    rows = [
        {
            "file": job.file,
            "number": str(job.mutant.line),
            "function": job.mutant.function,
            "line": line_text(job),
            "change": change_text(job.mutant),
            "result": result,
            "test": test,
        }
        for job, result, test in sorted(outcomes, key=lambda outcome: order[outcome.job])
    ]
    error = session.error or ("" if len(rows) == len(to_run) else "not every mutant was run")
    known_here = sum(entry is not None for entry in entries)
    return {"module": module.name, "mutants": len(jobs), "known": known_here, "error": error, "outcomes": rows}


def _survivors(result: dict[str, Any]) -> list[dict[str, str]]:
    return [row for row in result["outcomes"] if row["result"] != "killed"]


def _print_survivors(console: Console, result: dict[str, Any]) -> None:
    if result.get("error"):
        console.print(f"{result['module']}: {result['error']}", markup=False)
    for row in _survivors(result):
        where = f"{row['file']}:{row['number']} {row['function']}"
        console.print(f"{where}: {row['result']}: {row['change']}\n    {row['line']}", markup=False)


def _summary(results: list[dict[str, Any]]) -> Table:
    """Return the table by module; the score is what was killed of what was run, in percent."""
    table = Table("module", "mutants", "change nothing", "run", "killed", "survive", "score [%]")
    for result in results:
        run, left = len(result["outcomes"]), len(_survivors(result))
        score = f"{100 * (run - left) / run:.1f}" if run else "-"
        counts = result.get("mutants", 0), result.get("known", 0), run, run - left, left
        table.add_row(result["module"], *map(str, counts), score)
    return table


if __name__ == "__main__":
    sys.exit(main())
