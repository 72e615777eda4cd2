"""Draws `floors.png`: the rooms of the three packages, floor by floor, and which libraries each of them imports.

Floors are those of the contracts in `pyproject.toml`, and hold of the real imports, or nothing is drawn: each room
imports rooms below it alone. With what `make test` installs, anywhere: `python data/pictures/floors.py [PICTURE.png]`.
"""

import json
import re
import sys
import tomllib
from pathlib import Path

import grimp
import matplotlib.style
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch

ROOT = Path(__file__).parents[2]
PACKAGES = ("pipeline", "replay", "recorders")
_CAPTIONS = {
    "pipeline": "A room imports rooms on floors below its own, and packages below. Orange: libraries it imports.",
    "replay": "Knows nothing of robots and learners.",
    "recorders": "The log and the wire.",
}
_LIBRARIES = {
    "pydrake": "Drake",
    "zenoh": "Zenoh",
    "rerun": "Rerun",
    "pinocchio": "Pinocchio",
    "numba": "numba",
    "matplotlib": "matplotlib",
}
_BLUE, _VERMILION, _GREY, _PALE = "#0072B2", "#D55E00", "#595959", "#F2F2F2"  # Okabe and Ito; told apart by all
_WIDTH_IN, _DPI = 10.0, 130
_FLOOR_IN, _GAP_IN, _TITLE_IN, _LEFT_IN = 0.46, 0.10, 0.42, 0.25

Floors = dict[str, list[list[str]]]


def import_graph() -> grimp.ImportGraph:
    """Return the real imports, those of libraries included."""
    sys.path.insert(0, str(ROOT))
    return grimp.build_graph(*PACKAGES, include_external_packages=True, cache_dir=None)


def contract_floors() -> Floors:
    """Return the rooms of each package by floor, from the top, as the contracts have them."""
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
    layers = {contract["containers"][0]: contract["layers"] for contract in contracts if "containers" in contract}
    return {package: [sorted(re.split(r" [|:] ", layer)) for layer in layers[package]] for package in PACKAGES}


def wrong_imports(graph: grimp.ImportGraph, floors: Floors) -> list[str]:
    """Return what does not hold of the real imports: rooms on no floor, and imports that do not run down."""
    wrong = []
    for package in PACKAGES:
        height = {room: -floor for floor, rooms in enumerate(floors[package]) for room in rooms}
        real = {module.split(".")[1] for module in graph.find_children(package)}
        wrong += [f"{package}.{room}: on a floor or in the package alone" for room in real ^ set(height)]
        wrong += [
            f"{package}.{room} imports {package}.{other}"
            for room in real & set(height)
            for other in _imported(graph, package, room) & set(height)
            if height[other] >= height[room]
        ]
    return sorted(wrong)


def libraries(graph: grimp.ImportGraph) -> dict[str, list[str]]:
    """Return the libraries that each room imports itself, by room; rooms that import none of them are left out."""
    rooms: dict[str, set[str]] = {}
    for library, name in _LIBRARIES.items():
        for module in graph.find_modules_that_directly_import(library) if library in graph.modules else ():
            rooms.setdefault(".".join(module.split(".")[:2]), set()).add(name)
    return {room: sorted(names) for room, names in sorted(rooms.items())}


def _imported(graph: grimp.ImportGraph, package: str, room: str) -> set[str]:
    modules = {f"{package}.{room}"} | graph.find_descendants(f"{package}.{room}")
    imported = {name for module in modules for name in graph.find_modules_directly_imported_by(module)}
    return {name.split(".")[1] for name in imported if name.startswith(f"{package}.")} - {room}


def draw(path: Path) -> None:
    """Draw the picture to a PNG file, which carries what it shows as a text too."""
    graph, floors = import_graph(), contract_floors()
    if wrong := wrong_imports(graph, floors):
        raise SystemExit("\n".join(wrong))
    used = libraries(graph)
    height = sum(_TITLE_IN + _FLOOR_IN * len(rooms) + _GAP_IN for rooms in floors.values()) + 0.1
    with matplotlib.style.context(["default", {"font.size": 8.5}]):
        figure = Figure(figsize=(_WIDTH_IN, height), dpi=_DPI)
        axes = figure.add_axes((0.0, 0.0, 1.0, 1.0), xlim=(0.0, _WIDTH_IN), ylim=(0.0, height))
        axes.set_axis_off()
        top = height - 0.05
        for package in PACKAGES:
            top = _draw_package(axes, top, package, floors[package], used)
        metadata = {"Software": None, "Description": json.dumps({"floors": floors, "libraries": used})}
        figure.savefig(path, metadata=metadata)


def _draw_package(axes: Axes, top: float, package: str, floors: list[list[str]], used: dict[str, list[str]]) -> float:
    """Draw a package from `top` [in] downwards, and return where the next one begins."""
    height = _TITLE_IN + _FLOOR_IN * len(floors)
    _box(axes, (0.1, top - height), (_WIDTH_IN - 0.2, height), colour=_GREY, fill="white")
    axes.text(_LEFT_IN, top - 0.2, f"{package}/", va="center", weight="bold", size=11.0)
    axes.text(_LEFT_IN + 1.05, top - 0.2, _CAPTIONS[package], va="center", color=_GREY)
    for number, rooms in enumerate(floors):
        bottom = top - _TITLE_IN - _FLOOR_IN * (number + 1) + 0.04
        width = (_WIDTH_IN - 2 * _LEFT_IN + 0.1) / max(len(rooms), 3)
        left = (_WIDTH_IN - width * len(rooms)) / 2
        for place, room in enumerate(rooms):
            names = used.get(f"{package}.{room}", [])
            _box(axes, (left + width * place + 0.05, bottom), (width - 0.1, _FLOOR_IN - 0.08), colour=_BLUE)
            centre = left + width * (place + 0.5), bottom + (_FLOOR_IN - 0.08) / 2
            axes.text(centre[0], centre[1] + (0.075 if names else 0.0), room, ha="center", va="center", weight="bold")
            y = centre[1] - 0.09
            axes.text(centre[0], y, ", ".join(names), ha="center", va="center", color=_VERMILION, size=7.0)
    return top - height - _GAP_IN


def _box(axes: Axes, corner: tuple[float, float], size: tuple[float, float], *, colour: str, fill: str = _PALE) -> None:
    shape = "round,pad=0,rounding_size=0.06"
    axes.add_patch(FancyBboxPatch(corner, *size, boxstyle=shape, facecolor=fill, edgecolor=colour, linewidth=1.0))


if __name__ == "__main__":
    draw(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).with_suffix(".png"))
