"""Makes the pages of the documentation that no file in `data` holds: the project's own, and the reference.

`mkdocs.yml` names it as a hook; `make docs` runs it.
"""

import ast
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

_ROOT = Path(__file__).parents[2]
_PACKAGES = ("pipeline", "replay", "recorders")
_PROJECT_PAGES = {"README.md": "index.md", "CONTRIBUTING.md": "", "CHANGELOG.md": "", "SECURITY.md": ""}


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Add the reference to the navigation: rooms under their package."""
    pages = [{package: [_page(room) for room in _rooms(package)]} for package in _PACKAGES]
    (config.nav or []).append({"Reference": pages})
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages themselves."""
    for package in _PACKAGES:
        for room in _rooms(package):
            files.append(File.generated(config, _page(room), content=_reference(room)))
    for name, page in _PROJECT_PAGES.items():
        files.append(File.generated(config, page or name, content=_project_page(name)))
    return files


def _rooms(package: str) -> list[str]:
    """Return a package and the rooms in it, as modules."""
    inits = sorted((_ROOT / package).rglob("__init__.py"))
    return [".".join(path.parent.relative_to(_ROOT).parts) for path in inits]


def _page(room: str) -> str:
    return f"reference/{room}.md"


def _public_names(package: str) -> str:
    """Return the names that a package exports, in a table; each links to where it is documented."""
    tree = ast.parse((_ROOT / package / "__init__.py").read_text(encoding="utf-8"))
    homes: dict[str, tuple[str, ...]] = next(
        ast.literal_eval(node.value)
        for node in tree.body
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "_HOMES"
    )
    rows = [
        f"| [`{name}`]({home.rpartition('.')[0]}.md#{home}.{name}) | `{home}` |"
        for name, home in sorted((name, home) for home, names in homes.items() for name in names)
    ]
    return "\n".join(["", "## Public names", "", f"| `from {package} import` | of |", "|---|---|", *rows, ""])


def _reference(room: str) -> str:
    """Return a page with the modules that lie in a room itself; rooms within it have pages of their own."""
    modules = sorted(path.stem for path in _ROOT.joinpath(*room.split(".")).glob("[!_]*.py"))
    blocks = [f"::: {room}\n    options:\n      show_submodules: false\n      members: false\n"]
    blocks += [f"::: {room}.{module}\n    options:\n      heading_level: 2\n" for module in modules]
    names = _public_names(room) if room in _PACKAGES else ""
    return f"---\ntitle: {room}\n---\n\n" + blocks[0] + names + "\n" + "\n".join(blocks[1:])


def _project_page(name: str) -> str:
    """Return a page of the project's root, its links as they are from `data`."""
    text = (_ROOT / name).read_text(encoding="utf-8").replace("](data/", "](")
    return text.replace("](README.md)", "](index.md)").replace("](LICENSE)", "](index.md)")
