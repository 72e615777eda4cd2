"""The digests that the README prints are those that the demo is compared with."""

import json
from pathlib import Path

import pytest

import pipeline
from pipeline.published import FILE, published_digests, published_line
from pipeline.resources import data_path

README = (Path(pipeline.__file__).parent.parent / "README.md").read_text()
DIGESTS = published_digests(seed=0, epochs=150)


def test_the_readme_prints_them() -> None:
    assert DIGESTS is not None
    assert list(DIGESTS) == ["circles.mcap", "eight.mcap", "controller.npz"]
    assert "\n".join(f"    {name:<14}  {digest}" for name, digest in DIGESTS.items()) in README
    assert json.loads(data_path(FILE).read_text())["digests"] == DIGESTS


@pytest.mark.parametrize(("seed", "epochs"), [(1, 150), (0, 8)])
def test_they_are_of_one_seed_and_number_of_epochs(seed: int, epochs: int) -> None:
    assert published_digests(seed=seed, epochs=epochs) is None


def test_what_differs_is_named() -> None:
    assert DIGESTS is not None
    assert published_line(DIGESTS, DIGESTS) == "As published: yes."
    other = DIGESTS | {"eight.mcap": "0" * 64}
    expected = f"As published: no: eight.mcap: expected {DIGESTS['eight.mcap'][:16]}, found {'0' * 16}."
    assert published_line(other, DIGESTS) == expected
    without = {name: digest for name, digest in DIGESTS.items() if name != "eight.mcap"}
    assert "eight.mcap: expected " in published_line(without, DIGESTS)
    assert published_line(without, DIGESTS).endswith("found none.")
