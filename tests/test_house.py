"""The house keeps its own rules: pages are true, lock files name no host, nothing large is committed."""

import ast
import doctest
import re
import shutil
import tomllib
from importlib.metadata import packages_distributions
from pathlib import Path
from typing import Any

import pytest
import typer

import pipeline
from pipeline.cli import app as cli
from pipeline.extras import EXTRAS
from recorders.errors import DISTRIBUTION

ROOT = Path(pipeline.__file__).parent.parent
README = (ROOT / "README.md").read_text()
GUIDES = {path.name: path.read_text() for path in (ROOT / "data" / "guides").glob("*.md")}
PAGES = {"README.md": README, "CONTRIBUTING.md": (ROOT / "CONTRIBUTING.md").read_text()} | GUIDES
LOCKS = ("requirements.lock", "requirements-core.lock", "requirements-dev.lock", "requirements-docs.lock")
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
PACKAGES = ("pipeline", "recorders", "replay")


def test_the_readme_lists_the_verbs_that_exist() -> None:
    table = README.partition("## Verbs")[2].partition("\n## ")[0]
    listed = re.findall(r"^\| `([a-z]+)` \| (?!does)", table, re.MULTILINE)
    verbs: dict[str, Any] = vars(typer.main.get_command(cli.app))["commands"]
    alone = [name for name, command in verbs.items() if command.params or not hasattr(command, "commands")]
    assert sorted(listed) == sorted(alone)


@pytest.mark.parametrize("page", PAGES)
def test_a_page_names_files_that_exist(page: str) -> None:
    named = re.findall(r"[`(]((?:tests|data|pipeline|recorders|replay)/[\w./-]+)[`)]", PAGES[page])
    assert [name for name in named if not (ROOT / name).exists()] == []
    assert len(named) > 10 or page != "README.md"


def test_the_readme_links_every_guide() -> None:
    assert [name for name in GUIDES if f"(data/guides/{name})" not in README] == []


def test_each_promise_names_a_test() -> None:
    rows = re.findall(r"^\| (?!promise |---)(.*) \| (.*) \|$", GUIDES["promises.md"], re.MULTILINE)
    assert len(rows) > 25
    assert [promise for promise, tests in rows if not re.findall(r"`tests/[\w/]+\.py`", tests)] == []


def test_the_architecture_describes_every_room() -> None:
    rooms = {f"{package}/{path.parent.name}" for package in PACKAGES for path in (ROOT / package).glob("*/__init__.py")}
    described = {
        f"{package}/{room}"
        for package, text in re.findall(r"^## `(\w+)`.*?$(.*?)(?=^## |\Z)", GUIDES["architecture.md"], re.M | re.S)
        for names in re.findall(r"^(\*\*.*?)(?::|\(modules?\))", text, re.M)
        for room in re.findall(r"`(\w+)`", names)
    }
    assert rooms <= described
    assert [room for room in described if not list(ROOT.glob(f"{room}*"))] == []


def test_the_readme_names_commands_that_exist() -> None:
    targets = set(re.findall(r"^([a-z0-9-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    named = set(re.findall(r"make ([a-z0-9-]+)", README))
    assert {"demo", "test"} <= named <= targets


def test_the_readmes_example_runs(tmp_path: Path, episode: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (example,) = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
    assert len(example.strip().splitlines()) <= 10
    assert example.count(">>> from ") == 2
    demo = tmp_path / "out" / "demo"
    demo.mkdir(parents=True)
    for name in ("circles.mcap", "eight.mcap"):
        shutil.copy(episode, demo / name)
    monkeypatch.chdir(tmp_path)
    tried = doctest.DocTestParser().get_doctest(example, {}, "README", "README.md", 0)
    found: list[str] = []
    assert doctest.DocTestRunner(optionflags=doctest.ELLIPSIS).run(tried, out=found.append, clear_globs=False) == (0, 5)
    trainer, evaluate = tried.globs["trainer"], tried.globs["evaluate_motion"]
    assert re.fullmatch(r"[0-9a-f]{64}", trainer.result()["digest"])
    assert re.fullmatch(
        r"HandErrors\(.*samples=24.*\)", repr(evaluate(trainer.controller(), demo / "eight.mcap").errors)
    )


@pytest.fixture
def episode(tmp_path: Path) -> Path:
    from episodes import write_episode

    return write_episode(tmp_path / "episode.mcap")


@pytest.mark.parametrize("name", [*LOCKS, "pyproject.toml", "Makefile", "mkdocs.yml"])
def test_no_package_host_is_named(name: str) -> None:
    assert re.findall(r"https?://\S*|--(?:extra-)?index-url|file://", (ROOT / name).read_text()) == []


def test_every_locked_requirement_has_a_hash() -> None:
    for name in LOCKS:
        pinned = re.split(r"\n(?=\S)", (ROOT / name).read_text())
        assert all("--hash=sha256:" in entry for entry in pinned if "==" in entry.splitlines()[0])


@pytest.mark.parametrize("lock", ["requirements.lock", "requirements-core.lock"])
def test_what_runs_is_what_is_developed_with(lock: str) -> None:
    def pins(name: str) -> set[str]:
        return set(re.findall(r"^[\w.-]+==\S+", (ROOT / name).read_text(), re.MULTILINE))

    assert len(pins(lock)) > 30
    assert pins(lock) <= pins("requirements-dev.lock")


def test_the_core_is_locked_without_its_extras() -> None:
    extras = {re.split(r"[^\w-]", name)[0] for names in PROJECT["optional-dependencies"].values() for name in names}
    locked = set(re.findall(r"^[\w-]+", (ROOT / "requirements-core.lock").read_text(), re.MULTILINE))
    assert {"drake", "rerun-sdk", "matplotlib", "distributed"} <= extras
    assert locked & extras == set()


def test_each_extra_that_an_error_names_can_be_installed() -> None:
    extras = PROJECT["optional-dependencies"]
    assert PROJECT["name"] == DISTRIBUTION
    assert set(EXTRAS.values()) <= set(extras)
    assert extras["all"] == [f"{DISTRIBUTION}[{','.join(name for name in extras if name != 'all')}]"]


def test_each_package_beyond_the_core_has_its_extra_named() -> None:
    trees = [ast.parse(path.read_text()) for package in PACKAGES for path in (ROOT / package).rglob("*.py")]
    nodes = [node for tree in trees for node in ast.walk(tree)]
    imported = {alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names}
    imported |= {node.module or "" for node in nodes if isinstance(node, ast.ImportFrom)}
    locked = set(re.findall(r"^[\w-]+", (ROOT / "requirements-core.lock").read_text(), re.MULTILINE))
    wanted = set()
    for package, distributions in packages_distributions().items():
        if any(name.split(".")[0] == package for name in imported):
            names = {re.sub("[._]", "-", distribution.lower()) for distribution in distributions}
            wanted |= set() if names & locked else {package}
    wanted -= {*PACKAGES}
    assert {"pydrake", "rerun", "matplotlib"} <= wanted
    assert wanted - {"example_robot_data"} <= set(EXTRAS)  # an error of its own says which robot needs it


def test_every_page_tells_of_the_same_pythons() -> None:
    stated = {line.rpartition(" ")[2] for line in PROJECT["classifiers"] if " :: Python :: 3." in line}
    assert stated == {"3.11", "3.12", "3.13"}
    assert PROJECT["requires-python"] == ">=3.11,<3.14"
    for page in ("README.md", "Makefile"):
        assert "CPython 3.11, 3.12 or 3.13" in (ROOT / page).read_text(), page
    assert set(re.findall(r"^for version in (.*);", (ROOT / ".ci" / "run").read_text(), re.M)) == {"3.12 3.13"}


def test_before_a_commit_runs_what_ci_checks() -> None:
    (entry,) = re.findall(r"entry: (.*)", (ROOT / ".pre-commit-config.yaml").read_text())
    assert entry == "make check"
    assert re.search(r"^test: check ", (ROOT / "Makefile").read_text(), re.MULTILINE)


def test_the_citation_is_of_this_version() -> None:
    assert f"\nversion: {PROJECT['version']}\n" in (ROOT / "CITATION.cff").read_text()


def test_nothing_that_is_shipped_is_large() -> None:
    shipped = [
        path for name in ("pipeline", "recorders", "replay", "tests", "data") for path in (ROOT / name).rglob("*")
    ]
    large = [
        path for path in shipped if path.is_file() and "__pycache__" not in path.parts and path.stat().st_size > 2**20
    ]
    assert large == []
