"""A session of pytest that meets mutants: tests are collected once, and each mutant runs in a fork of its own.

The files stay as they are. Where a change stands in a function, the functions of the fork take the changed code on;
anywhere else the module is imported anew from the changed tree, and its tests are collected again. Processes that tests
start run the files as they are: what only they run counts as reached by no test.
"""

import ast
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from types import FunctionType
from typing import Any, NamedTuple

import coverage
import pytest
from mutant_codes import ChangedModule, changed_functions, forget_modules, functions_of, statement_at, take_on
from mutant_forks import OUT_OF_TIME, Task, limit_processor_time, run_in_forks
from mutation import Mutant, mutated_tree

ROOT = Path(__file__).parents[2]
OPTIONS = (
    "-q",
    "-p",
    "no:cacheprovider",
    "-W",
    "ignore::RuntimeWarning",
    "-W",
    "ignore::pytest.PytestAssertRewriteWarning",
)
KILLED, SURVIVED, UNREACHED = "killed", "survived", "reached by no test"

_OWN_MODULES = ("mutation", "mutant_codes", "mutant_forks", "mutant_session", "mutant_table", "__main__")
_MORE_S, _TIMES = 5, 10  # processor time that a test may take with a mutant beyond what it takes without it
_ALL_TESTS_S = 900


class Job(NamedTuple):
    """A mutant of one file."""

    file: str
    mutant: Mutant


class Outcome(NamedTuple):
    """A mutant's result, and the first test that failed."""

    job: Job
    result: str
    test: str


class Measured(NamedTuple):
    """The tests on the module as it is: which failed first, processor time of each [s], and lines that each reached."""

    failed: str
    seconds: dict[str, float]
    lines: dict[str, dict[str, list[int]]]  # by file, by test

    def tests_of(self, file: str, lines: range | None) -> list[str]:
        """Return the tests that reach any of these lines, the quickest first.

        Without lines those that reach anything in the file, and then those that reach no file at all: they look at
        constants.
        """
        by_test = self.lines.get(file, {})
        if lines is None:
            reaching = {test for tests in self.lines.values() for test in tests}
            return self._in_order(by_test) + self._in_order(self.seconds.keys() - reaching)
        return self._in_order(test for test, reached in by_test.items() if any(line in lines for line in reached))

    def _in_order(self, tests: Iterable[str]) -> list[str]:
        return sorted(tests, key=lambda test: (self.seconds[test], test))


class MutantSession:
    """Plugin of pytest that runs mutants in place of the tests that were collected.

    Parameters
    ----------
    jobs : sequence of Job
        The mutants.
    processes : int
        How many run at a time.
    finished : callable
        Called with each outcome as it comes.
    """

    def __init__(self, jobs: Sequence[Job], *, processes: int, finished: Callable[[Outcome], None]) -> None:
        self._jobs, self._processes, self._finished = list(jobs), processes, finished
        self._sources = {job.file: (ROOT / job.file).read_text() for job in jobs}
        self.error = ""  # why no mutant was run

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        """Run the tests once as they are, then every mutant."""
        if session.testsfailed:
            self.error = "the tests cannot be collected"
            return True
        measured = self._measure(session.items)
        if measured.failed:
            self.error = f"the tests do not hold without a mutant: {measured.failed}"
            return True
        functions = {file: functions_of(str(ROOT / file)) for file in self._sources}
        tasks = ((job, self._task(job, measured, session.items, functions[job.file])) for job in self._jobs)
        run_in_forks(tasks, processes=self._processes, done=self._done)
        return True

    def _measure(self, items: list[pytest.Item]) -> Measured:
        results: list[Any] = []
        task = Task(lambda: _measure(items, list(self._sources)), _ALL_TESTS_S)
        run_in_forks([(None, task)], processes=1, done=lambda _, result: results.append(result))
        (result,) = results
        return Measured(*result) if isinstance(result, list) else Measured(result, {}, {})

    def _task(self, job: Job, measured: Measured, items: list[pytest.Item], functions: list[FunctionType]) -> Task:
        seconds = sum(measured.seconds[test] for test in measured.tests_of(job.file, None))
        return Task(lambda: self._meet(job, measured, items, functions), _MORE_S + int(_TIMES * seconds))

    def _meet(self, job: Job, measured: Measured, items: list[pytest.Item], functions: list[FunctionType]) -> list[str]:
        source, path = self._sources[job.file], str(ROOT / job.file)
        tree = mutated_tree(source, job.mutant)
        codes = changed_functions(compile(source, path, "exec"), compile(tree, path, "exec"))
        tests = measured.tests_of(job.file, None if codes is None else statement_at(source, job.mutant.line))
        if not tests:
            return [UNREACHED, ""]
        if codes is None:
            failed = _run_anew(job.file, tree, tests)
        else:
            take_on(functions, codes)
            failed = _first_failure(_in_order(items, tests), measured.seconds)
        return [KILLED, failed] if failed else [SURVIVED, ""]

    def _done(self, job: Job, result: Any) -> None:
        if isinstance(result, list):
            self._finished(Outcome(job, *result))
        elif result == OUT_OF_TIME or result.startswith("SIG"):
            self._finished(Outcome(job, KILLED, result))
        else:
            raise RuntimeError(f"{job.file}, {job.mutant}: {result}")


class _Failures:
    """Plugin that notes the first test that fails, and may choose tests and their order."""

    def __init__(self, tests: Sequence[str] = ()) -> None:
        self._tests = tests
        self.first = ""

    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        items[:] = _in_order(items, self._tests)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.failed and not self.first:
            self.first = report.nodeid

    def pytest_collectreport(self, report: pytest.CollectReport) -> None:
        if report.failed and not self.first:
            self.first = f"{report.nodeid} (collection)"


def _in_order(items: Sequence[pytest.Item], tests: Sequence[str]) -> list[pytest.Item]:
    by_name = {item.nodeid: item for item in items}
    return [by_name[test] for test in tests if test in by_name]


def _run(items: Sequence[pytest.Item]) -> Iterator[tuple[pytest.Item, str]]:
    """Run tests; yield each, and the first that failed so far."""
    failures = _Failures()
    if items:
        items[0].config.pluginmanager.register(failures)
    for item, following in zip(items, [*items[1:], None], strict=True):
        item.config.hook.pytest_runtest_protocol(item=item, nextitem=following)
        yield item, failures.first


def _first_failure(items: Sequence[pytest.Item], seconds: Mapping[str, float]) -> str:
    """Run tests up to the first that fails; each may take so many times longer than without a mutant."""
    running = _run(items)
    for item in items:
        limit_processor_time(_MORE_S + int(_TIMES * seconds[item.nodeid]))
        try:
            _, failed = next(running)
        except Exception as error:  # what pytest collects between tests, such as files that were left open
            failed = f"{item.nodeid} ({type(error).__name__})"
        if failed:
            return failed
    return ""


def _run_anew(file: str, tree: ast.Module, tests: Sequence[str]) -> str:
    """Import everything again, the module from the changed tree, and run its tests; return the first that failed."""
    forget_modules(str(ROOT), but=_OWN_MODULES)
    sys.meta_path.insert(0, ChangedModule(file.removesuffix(".py").removesuffix("/__init__").replace("/", "."), tree))
    failures = _Failures(tests)
    files = sorted({test.partition("::")[0] for test in tests})
    code = pytest.main(["-x", *OPTIONS, *files], plugins=[failures])
    return failures.first or ("" if code == pytest.ExitCode.OK else f"{pytest.ExitCode(code).name.lower()}")


class _Tracing:
    """Plugin that traces which test reaches which lines; what a fixture of several tests reaches, all of them do."""

    def __init__(self, paths: dict[str, str]) -> None:
        self._paths = paths
        self._tracer = coverage.Coverage(data_file=None, config_file=False, include=list(paths.values()))

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(self, fixturedef: pytest.FixtureDef[Any], request: pytest.FixtureRequest) -> Any:
        if fixturedef.scope == "function":
            return (yield)
        self._tracer.switch_context(f"{request.node.nodeid}::")
        try:
            return (yield)
        finally:
            self._tracer.switch_context(request._pyfuncitem.nodeid)

    def measure(self, items: Sequence[pytest.Item]) -> Measured:
        seconds: dict[str, float] = {}
        running = _run(items)
        self._tracer.start()
        for item in items:
            self._tracer.switch_context(item.nodeid)
            start = time.process_time()
            _, failed = next(running)
            seconds[item.nodeid] = time.process_time() - start
            if failed:
                return Measured(failed, {}, {})
        self._tracer.stop()
        return Measured("", seconds, {file: self._lines(path, list(seconds)) for file, path in self._paths.items()})

    def _lines(self, path: str, tests: list[str]) -> dict[str, list[int]]:
        by_test: dict[str, list[int]] = {}
        for line, contexts in self._tracer.get_data().contexts_by_lineno(path).items():
            for context in filter(None, contexts):
                for test in [context] if context in tests else [test for test in tests if test.startswith(context)]:
                    by_test.setdefault(test, []).append(line)
        return by_test


def _measure(items: Sequence[pytest.Item], files: Sequence[str]) -> Measured:
    """Run every test with its lines traced."""
    tracing = _Tracing({file: str(ROOT / file) for file in files})
    items[0].config.pluginmanager.register(tracing)
    return tracing.measure(items)
