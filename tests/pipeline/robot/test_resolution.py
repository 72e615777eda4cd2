"""What sensors measure and motors take lies on grids of powers of two, which every robot of ours states."""

import re
from dataclasses import astuple

import numpy as np
import pytest

from pipeline.robot.config import load_robot, parse_robot, robot_names
from pipeline.robot.resolution import COARSEST, FINEST, UNLIMITED, Resolution, on_grid
from recorders.errors import RobotError

ASIMO = load_robot("asimo")
STEP = 2.0**-20


def test_every_robot_here_has_a_resolution() -> None:
    assert {load_robot(name).resolution for name in robot_names()} == {Resolution(STEP, 2.0**-16, STEP, STEP, STEP)}


def test_a_robot_without_one_is_as_it_is_computed() -> None:
    assert parse_robot(ASIMO.toml_text.partition("[resolution]")[0], ASIMO.urdf_text).resolution == UNLIMITED
    values = np.random.default_rng(0).normal(size=100)
    assert set(astuple(UNLIMITED)) == {0.0}
    assert on_grid(values, 0.0).tobytes() == values.tobytes()


def test_values_go_to_the_nearest_point_of_the_grid_and_stay_there() -> None:
    values = np.random.default_rng(0).uniform(-10.0, 10.0, 10_000)
    rounded = on_grid(values, STEP)
    assert np.abs(rounded - values).max() <= STEP / 2.0
    assert (rounded / STEP == np.rint(rounded / STEP)).all()
    assert on_grid(rounded, STEP).tobytes() == rounded.tobytes()


def test_last_bits_are_gone() -> None:
    """But where they lie within the middle between two points."""
    values = np.random.default_rng(1).uniform(-3.0, 3.0, 10_000)
    for noise in (-5e-16, 5e-16):
        assert on_grid(values + noise, STEP).tobytes() == on_grid(values, STEP).tobytes()
    middle = STEP / 2.0
    assert on_grid([np.nextafter(middle, 0.0), np.nextafter(middle, 1.0)], STEP).tolist() == [0.0, STEP]


def test_there_is_no_zero_below_zero() -> None:
    assert on_grid([-1e-17, -0.0, 1e-17], STEP).tobytes() == np.zeros(3).tobytes()


def test_what_is_absurd_stays_as_it_is() -> None:
    absurd = np.array([1.7e308, -1.7e308, 1e200, np.inf, -np.inf, np.nan])
    assert on_grid(absurd, FINEST).tobytes() == absurd.tobytes()


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("hands = 0.001", r"\[resolution\] hands of the robot config: expected a power of two .*, found 0.001"),
        ("hands = 0", "expected a power of two from .* found 0"),
        ("hands = -0.5", "expected a power of two from .* found -0.5"),
        (f"hands = {COARSEST * 2}", "expected a power of two from .* to 1.0, .* found 2.0"),
        (f"hands = {FINEST / 2}", "expected a power of two from .* found "),
        ('hands = "2^-20"', "expected a finite number"),
        ("", r"\[resolution\] lacks hands"),
        ("hands = 0.5\nfeet = 0.5", r"\[resolution\] has unknown feet"),
    ],
)
def test_a_wrong_resolution_is_one_clear_error(line: str, message: str) -> None:
    text = re.sub(r"^hands = .*$", line, ASIMO.toml_text, flags=re.MULTILINE)
    with pytest.raises(RobotError, match=message) as caught:
        parse_robot(text, ASIMO.urdf_text)
    assert "\n" not in str(caught.value)
