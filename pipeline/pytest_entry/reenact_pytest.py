"""The pytest plugin's entry point, `pytest --golden DIR`: imports nothing of this program unless the option is given.

It stands at the top level of an installed wheel, with a name of its own: pytest loads it in every project of the
environment, and a project may well have a folder `pipeline` or `replay` itself.
"""

import sys
from importlib.machinery import PathFinder
from pathlib import Path

import pytest

_PACKAGES = ("pipeline", "recorders", "replay")


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
    """Have the cases collected, if there are folders to look into.

    Raises
    ------
    pytest.UsageError
        If a folder has no cases, or the project has a package of the same name as one of this program's.
    """
    folders: list[str] = config.getoption("golden")
    if not folders:
        return
    _refuse_namesakes(config)
    from pipeline.pytest_plugin import GoldenCases  # noqa: PLC0415  # only where cases are asked for

    config.pluginmanager.register(GoldenCases(config, folders), "reenact-golden")


def _refuse_namesakes(config: pytest.Config) -> None:
    """Refuse to run where one process would need two packages of one name: the project's, and this program's."""
    own = next((Path(place) for place in sys.path if Path(place, "pipeline", "pytest_plugin.py").is_file()), Path())
    here, root = config.invocation_params.dir, config.rootpath  # a folder given from elsewhere may bring another root
    search = [*([str(root)] if here.is_relative_to(root) else []), str(here), *sys.path]
    for name in _PACKAGES:
        spec = PathFinder.find_spec(name, search)
        found = None if spec is None or spec.origin is None else Path(spec.origin)
        if found is not None and not found.resolve().is_relative_to((own / name).resolve()):
            raise pytest.UsageError(
                f"--golden: expected the package {name} of reenact, found {found} of the same name in this project; "
                "check the cases with `reenact golden check DIR`"
            )
