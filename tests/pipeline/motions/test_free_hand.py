"""The drawings that come with the program: made by their generator, as wide as they say, at the speed of a hand."""

from pathlib import Path

import numpy as np
import pytest

from pipeline.motions.drawings import COMMENT, DRAWINGS, PEAK_M_S, WIDE_M, house, spiral, write_motion_csv
from pipeline.motions.motion import load_motion
from pipeline.resources import data_path
from pipeline.robot.config import load_robot

ROBOT = load_robot("asimo")


@pytest.mark.parametrize("name", DRAWINGS)
def test_each_is_what_its_generator_makes_and_says_so(name: str, tmp_path: Path) -> None:
    write_motion_csv(DRAWINGS[name](ROBOT), tmp_path / "again.csv", ROBOT.hand_names, comment=COMMENT)
    text = data_path("motions", f"{name}.csv").read_text()
    assert (tmp_path / "again.csv").read_text() == text
    assert "no person drew this" in text.splitlines()[0]


def test_every_drawing_has_a_generator() -> None:
    assert {path.stem for path in data_path("motions").glob("*.csv")} == set(DRAWINGS)


@pytest.mark.parametrize("name", ["right_hand_house", "right_hand_spiral"])
def test_house_and_spiral_are_40_cm_wide_and_drawn_like_a_hand_draws(name: str) -> None:
    drawing = load_motion(name, ROBOT)
    np.testing.assert_array_equal(drawing.targets[:, 0], np.broadcast_to(ROBOT.centres[0], drawing.targets[:, 0].shape))
    offsets = drawing.targets[:, 1] - ROBOT.centres[1]
    np.testing.assert_allclose(np.abs(offsets).max(axis=0), [0.0, WIDE_M, WIDE_M], atol=0.01)
    speed = np.linalg.norm(np.diff(drawing.targets[:, 1], axis=0), axis=1) / 0.1
    assert 0.2 < speed.max() <= PEAK_M_S * 1.001
    assert speed[[0, -1]].max() < 0.1  # from rest to rest


def test_the_hand_stops_at_the_corners_of_the_house() -> None:
    drawing = load_motion("right_hand_house", ROBOT)
    speed = np.linalg.norm(np.diff(drawing.targets[:, 1], axis=0), axis=1) / 0.1
    slow = speed < 0.12
    assert int((slow[1:] & ~slow[:-1]).sum()) == 8  # strokes


@pytest.mark.parametrize("draw", [house, spiral])
def test_another_seed_draws_otherwise(draw) -> None:
    assert draw(ROBOT, seed=11).sha256 == draw(ROBOT, seed=11).sha256 != draw(ROBOT, seed=12).sha256
