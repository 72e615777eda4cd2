"""The digests that the README prints are those that the demo is compared with."""

import json
from pathlib import Path

import pytest

import pipeline
from pipeline.published import FILE, published_digests, published_line
from pipeline.resources import data_path

README = (Path(pipeline.__file__).parent.parent / "README.md").read_text()
DIGESTS = published_digests(seed=0, epochs=150, duration_s=120.0)


def test_the_readme_prints_them() -> None:
    assert DIGESTS is not None
    assert {"circles.mcap", "eight.mcap", "volume.mcap", "self_explored.mcap"} < set(DIGESTS)
    assert {"controller.npz", "deployable.npz", "self_taught.npz"} < set(DIGESTS)
    assert "\n".join(f"    {name:<18}  {digest}" for name, digest in DIGESTS.items()) in README
    assert json.loads(data_path(FILE).read_text())["digests"] == DIGESTS


@pytest.mark.parametrize(("seed", "epochs", "duration_s"), [(1, 150, 120.0), (0, 8, 120.0), (0, 150, 10.0)])
def test_they_are_of_one_run(seed: int, epochs: int, duration_s: float) -> None:
    assert published_digests(seed=seed, epochs=epochs, duration_s=duration_s) is None


def test_what_differs_is_named() -> None:
    assert DIGESTS is not None
    assert published_line(DIGESTS, DIGESTS) == "As published: yes."
    other = DIGESTS | {"eight.mcap": "0" * 64}
    expected = f"As published: no: eight.mcap: expected {DIGESTS['eight.mcap'][:16]}, found {'0' * 16}."
    assert published_line(other, DIGESTS) == expected
    without = {name: digest for name, digest in DIGESTS.items() if name != "eight.mcap"}
    assert "eight.mcap: expected " in published_line(without, DIGESTS)
    assert published_line(without, DIGESTS).endswith("found none.")
