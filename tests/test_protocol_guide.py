"""The guide to the protocol is true of the machines: their states, and how long their files are."""

import importlib.util
from pathlib import Path

import pipeline

ROOT = Path(pipeline.__file__).parent.parent


def test_the_diagrams_are_those_of_the_machines() -> None:
    spec = importlib.util.spec_from_file_location("states", ROOT / "data" / "pictures" / "states.py")
    assert spec is not None
    assert spec.loader is not None
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    text = script.GUIDE.read_text()
    assert text == script.renewed(text), "draw them again: python data/pictures/states.py"


def test_it_names_every_file_of_the_protocol_and_none_is_long() -> None:
    text = (ROOT / "data" / "guides" / "protocol.md").read_text()
    for path in (ROOT / "recorders" / "protocol").rglob("*.py"):
        assert len(path.read_text().splitlines()) <= 250, path
        assert path.name == "__init__.py" or f"`{path.name}`" in text, path
