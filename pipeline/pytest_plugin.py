"""The pytest plugin: `pytest --golden DIR` collects every golden case of a folder as a test."""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from _pytest._code.code import TerminalRepr

    from replay.golden_finding import Finding

_CASE_FILE = "case.json"  # as `replay.golden_case` has it; nothing of ours is imported before a case is collected


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the option."""
    group = parser.getgroup("reenact", "golden-log regression")
    group.addoption(
        "--golden",
        action="append",
        default=[],
        metavar="DIR",
        help="collect the golden cases of this folder as tests; may be repeated",
    )


def pytest_configure(config: pytest.Config) -> None:
    """Collect the folders beside whatever else is collected."""
    for folder in config.getoption("golden"):
        if not Path(folder).is_dir():
            raise pytest.UsageError(f"--golden: expected a folder of golden cases, found {folder}")
        if folder not in config.args:
            config.args.append(folder)


def pytest_collect_directory(path: Path, parent: pytest.Collector) -> pytest.Collector | None:
    """Take the folder of a case, if it lies in one of the folders that were asked for."""
    folders = [Path(folder).resolve() for folder in parent.config.getoption("golden")]
    asked = any(path.resolve().is_relative_to(folder) for folder in folders)
    if not asked or not (path / _CASE_FILE).is_file():
        return None
    collector: pytest.Collector = GoldenFolder.from_parent(parent, path=path)
    return collector


class GoldenFolder(pytest.Directory):
    """The folder of one case."""

    def collect(self) -> Iterator[pytest.Item]:
        """Yield the case as the one test that it is."""
        yield GoldenItem.from_parent(self, name="golden")


class GoldenItem(pytest.Item):
    """One golden case."""

    def runtest(self) -> None:
        """Check the case; raises GoldenFailure, which holds the first divergence."""
        from pipeline.golden_runner import GoldenRunner  # noqa: PLC0415  # costs nothing where no case is run
        from replay.golden import check_case  # noqa: PLC0415

        finding = check_case(self.path, GoldenRunner()).finding
        if finding is not None:
            raise GoldenFailure(finding)

    def repr_failure(  # type: ignore[override]  # pytest's own style is a literal that it does not export
        self, excinfo: pytest.ExceptionInfo[BaseException], style: None = None
    ) -> "str | TerminalRepr":
        """Return the first divergence in place of a traceback."""
        if isinstance(excinfo.value, GoldenFailure):
            return f"golden case {self.path.name}: {excinfo.value}"
        return super().repr_failure(excinfo)

    def reportinfo(self) -> tuple[Path, None, str]:
        """Say what the test is."""
        return self.path, None, f"golden case {self.path.name}"


class GoldenFailure(Exception):
    """A golden case does not hold."""

    def __init__(self, finding: "Finding") -> None:
        super().__init__(str(finding))
        self.finding = finding
