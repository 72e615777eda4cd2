"""The pytest plugin: `pytest --golden DIR` collects every golden case of a folder as a test; see `reenact_pytest`."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from recorders.errors import ConfigError
from replay.golden.folder import find_cases  # nothing heavy of ours is imported before a case is run

if TYPE_CHECKING:
    from _pytest._code.code import TerminalRepr

    from replay.golden.finding import Finding


class GoldenCases:
    """The hooks that collect golden cases; registered by `reenact_pytest`, which pytest loads.

    Parameters
    ----------
    config : pytest.Config
        Of the run; the folders are collected beside whatever else is.
    folders : sequence of str
        Folders with cases.

    Raises
    ------
    pytest.UsageError
        If a folder has none.
    """

    def __init__(self, config: pytest.Config, folders: Sequence[str]) -> None:
        self._folders = [Path(folder).resolve() for folder in folders]
        self._cases: set[Path] = set()
        for folder in folders:
            try:
                self._cases.update(case.resolve() for case in find_cases(Path(folder)))
            except ConfigError as error:
                raise pytest.UsageError(f"--golden: {error}") from error
            if folder not in config.args:
                config.args.append(folder)

    @pytest.hookimpl(tryfirst=True)
    def pytest_ignore_collect(self, collection_path: Path) -> bool | None:
        """Keep the cases, and what leads to them, from being ignored: pytest passes over folders such as `build`."""
        path = collection_path.resolve()
        asked = any(path.is_relative_to(folder) for folder in self._folders)
        collected = asked and any(case.is_relative_to(path) for case in self._cases)
        return False if collected else None

    def pytest_collect_directory(self, path: Path, parent: pytest.Collector) -> pytest.Collector | None:
        """Take the folder of a case, if it lies in one of the folders that were asked for."""
        if path.resolve() not in self._cases:
            return None
        collector: pytest.Collector = GoldenFolder.from_parent(parent, path=path)
        return collector

    @pytest.hookimpl(tryfirst=True)
    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        """Refuse to go on without a case, whatever pytest had against its folder; `-k` chooses after this."""
        collected = {item.path.resolve() for item in items if isinstance(item, GoldenItem)}
        missing = sorted(self._cases - collected)
        if missing:
            raise pytest.UsageError(
                f"--golden: expected {missing[0]} to be collected, found it ignored; give its folder alone"
            )


class GoldenFolder(pytest.Directory):
    """The folder of one case."""

    def collect(self) -> Iterator[pytest.Item]:
        """Yield the case as the one test that it is."""
        yield GoldenItem.from_parent(self, name="golden")


class GoldenItem(pytest.Item):
    """One golden case."""

    def runtest(self) -> None:
        """Check the case; raises GoldenFailure, which holds the first divergence."""
        from pipeline.golden.runner import GoldenRunner  # noqa: PLC0415  # costs nothing where no case is run
        from replay.golden.check import check_case  # noqa: PLC0415

        verdict = check_case(self.path, GoldenRunner())
        if verdict.finding is not None:
            raise GoldenFailure(verdict.finding)
        if verdict.physics is not None:
            self.add_report_section("call", "golden", f"physics {verdict.physics}")

    def repr_failure(  # type: ignore[override]  # pytest's own style is a literal that it does not export
        self, excinfo: pytest.ExceptionInfo[BaseException], style: None = None
    ) -> "str | TerminalRepr":
        """Return the first divergence in place of a traceback."""
        if isinstance(excinfo.value, GoldenFailure):
            return f"golden case {self.path.name}: {excinfo.value}"
        return super().repr_failure(excinfo)

    def reportinfo(self) -> tuple[Path, None, str]:
        """Return where the test is, and its name."""
        return self.path, None, f"golden case {self.path.name}"


class GoldenFailure(Exception):
    """A golden case does not hold."""

    def __init__(self, finding: "Finding") -> None:
        super().__init__(str(finding))
        self.finding = finding
