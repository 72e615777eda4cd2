"""The picture of the floors is true, and each import contract refuses what it forbids."""

import importlib.util
import json
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path
from types import ModuleType
from typing import Any

import grimp
import pytest
from PIL import Image

import pipeline

ROOT = Path(pipeline.__file__).parent.parent
PICTURE = ROOT / "data" / "pictures" / "floors.png"
CONTRACTS: list[dict[str, Any]] = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"][
    "contracts"
]
FLOORED = [container for contract in CONTRACTS for container in contract.get("containers", [])]


@pytest.fixture(scope="module")
def script() -> ModuleType:
    spec = importlib.util.spec_from_file_location("floors", PICTURE.with_suffix(".py"))
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def graph(script: ModuleType) -> grimp.ImportGraph:
    graph: grimp.ImportGraph = script.import_graph()
    return graph


def test_the_picture_has_the_floors_of_the_contracts_and_the_real_imports(
    script: ModuleType, graph: grimp.ImportGraph
) -> None:
    with Image.open(PICTURE) as image:
        drawn = json.loads(image.info["Description"])
    assert drawn["floors"] == script.contract_floors(), "draw it again: python data/pictures/floors.py"
    assert drawn["libraries"] == script.libraries(graph), "draw it again: python data/pictures/floors.py"
    assert PICTURE.stat().st_size < 200_000


def test_every_real_import_runs_down_the_floors(script: ModuleType, graph: grimp.ImportGraph) -> None:
    assert set(script.contract_floors()) == {"pipeline", "recorders", "replay"} <= set(FLOORED)
    assert script.wrong_imports(graph, script.contract_floors()) == []


def test_floors_that_do_not_hold_are_not_drawn(script: ModuleType, graph: grimp.ImportGraph) -> None:
    upside_down = {package: floors[::-1] for package, floors in script.contract_floors().items()}
    assert "replay.golden imports replay.sources" in script.wrong_imports(graph, upside_down)
    assert "recorders.cdr: on a floor or in the package alone" in script.wrong_imports(
        graph, script.contract_floors() | {"recorders": [["messages"]]}
    )


def planted(contract: dict[str, Any]) -> tuple[str, str]:
    """An import that a contract forbids: importer and imported."""
    (container,) = contract.get("containers", [""])
    layers = [re.split(" [|:] ", layer)[0] for layer in contract.get("layers", ["", ""])]
    top, bottom = (f"{container}.{layer}".strip(".") for layer in (layers[0], layers[-1]))
    return {
        "layers": (bottom, top),
        "independence": tuple(contract.get("modules", [])[:2]),
        "forbidden": (contract.get("source_modules", [""])[0], contract.get("forbidden_modules", [""])[0]),
        "protected": ("pipeline.terminal", contract.get("protected_modules", [""])[0]),
    }[contract["type"]]


@pytest.fixture(scope="module")
def refusals(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The report on a copy in which each contract is broken, and each package has a room on no floor."""
    copy = tmp_path_factory.mktemp("copy")
    shutil.copy(ROOT / "pyproject.toml", copy)
    for package in ("pipeline", "recorders", "replay"):
        shutil.copytree(ROOT / package, copy / package, ignore=shutil.ignore_patterns("__pycache__"))
    for container in FLOORED:
        copy.joinpath(*container.split("."), "attic.py").write_text("")
    for contract in CONTRACTS:
        importer, imported = planted(contract)
        place = copy.joinpath(*importer.split("."))
        with (place / "__init__.py" if place.is_dir() else place.with_suffix(".py")).open("a") as file:
            file.write(f"\nimport {imported}\n")
    lint = Path(sys.executable).with_name("lint-imports")
    run = subprocess.run([lint, "--no-logo", "--no-cache"], cwd=copy, capture_output=True, text=True, timeout=60)
    assert run.returncode == 1, run.stderr
    return run.stdout


@pytest.mark.parametrize("contract", CONTRACTS, ids=lambda contract: contract["name"])
def test_an_import_that_a_contract_forbids_is_refused(contract: dict[str, Any], refusals: str) -> None:
    name = contract["name"]
    assert re.search(rf"^{re.escape(name)} BROKEN", refusals, re.MULTILINE)
    complaint = re.split(rf"^{re.escape(name)}\n-+\n", refusals, flags=re.MULTILINE)[1]
    complaint = re.split(r"^-{4,}$", complaint, flags=re.MULTILINE)[0]
    importer, imported = planted(contract)
    assert re.search(rf"{re.escape(importer)}\s*(->|is not allowed to import)\s*{re.escape(imported)}\b", complaint)


@pytest.mark.parametrize("package", FLOORED)
def test_a_room_on_no_floor_is_refused(package: str, refusals: str) -> None:
    assert f"{package}.attic" in refusals
