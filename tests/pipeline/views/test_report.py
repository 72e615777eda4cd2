"""The report shows where both hands went, is the same for the same input, and says what it cannot draw."""

import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import matplotlib
import matplotlib.image
import numpy as np
import pytest

from pipeline.evaluation.errors import HandErrors
from pipeline.views.figures import MotionTest, draw_report
from recorders.errors import ConfigError, MotionError

BLUE, VERMILION, GREY = (0x00, 0x72, 0xB2), (0xD5, 0x5E, 0x00), (0x6B, 0x6B, 0x6B)
SAMPLES = 64


def hand_errors_of(means_cm: tuple[float, float], worst_cm: tuple[float, float]) -> HandErrors:
    means, worst = (dict(zip(("left", "right"), each, strict=True)) for each in (means_cm, worst_cm))
    return HandErrors(sum(means_cm) / 2.0, max(worst_cm), means, worst, SAMPLES)


def circles(*, left_up_m: float = 0.0) -> MotionTest:
    angle = np.arange(SAMPLES) * (2.0 * np.pi / SAMPLES)
    around = 0.1 * np.stack([0.0 * angle, np.cos(angle), np.sin(angle)], axis=1)
    targets = np.hstack([around + np.array([0.32, y, 0.76]) for y in (0.2, -0.2)])  # (T, 6)
    reached = targets.reshape(-1, 2, 3) + np.array([[0.0, 0.0, left_up_m], [0.0, 0.0, 0.01]])
    return MotionTest(
        "circles",
        targets,
        reached,
        hand_errors_of((0.9, 1.1), (1.4, 1.5)),
    )


def report(path: Path, **changes: Any) -> Path:
    arguments: dict[str, Any] = {
        "tests": [circles(), circles()],
        "errors_cm": [9.0, 3.0, 1.5, 1.3],
        "teacher_cm": 1.5,
        "linear_cm": 1.03,
        "paper_cm": 2.79,
        "title": "The hands go round",
    }
    draw_report(path, **(arguments | changes))
    return path


def pixels(path: Path, colour: tuple[int, int, int]) -> np.ndarray:
    """Rows and columns of the pixels that have a colour exactly, shape (n, 2)."""
    image = np.rint(matplotlib.image.imread(path)[..., :3] * 255)
    return np.argwhere((image == colour).all(axis=2))


def test_left_is_left_and_up_is_up_as_seen_from_behind(tmp_path: Path) -> None:
    path = report(tmp_path / "report.png", tests=[circles(left_up_m=0.15)])
    left, right = pixels(path, BLUE), pixels(path, VERMILION)
    assert left[:, 1].max() < right[:, 1].min()
    assert left[:, 0].mean() < right[:, 0].mean()


def test_a_robot_that_faces_the_other_way_is_seen_from_behind_too(tmp_path: Path) -> None:
    """Half a turn about the vertical: the same picture, to the byte, when the test knows the robot's plane."""
    test = circles(left_up_m=0.15)
    turn = np.array([-1.0, -1.0, 1.0])
    turned = replace(
        test, targets=test.targets * np.tile(turn, 2), reached=test.reached * turn, lateral=(0.0, -1.0, 0.0)
    )
    assert (
        report(tmp_path / "a.png", tests=[test]).read_bytes() == report(tmp_path / "b.png", tests=[turned]).read_bytes()
    )
    mirrored = replace(turned, lateral=(0.0, 1.0, 0.0))
    assert (mirrored.paths_cm(0)[0][:, 0] < 0.0).all()


@pytest.mark.parametrize(
    ("lateral", "up"),
    [((0.0, 1.0), (0.0, 0.0, 1.0)), ((0.0, 2.0, 0.0), (0.0, 0.0, 1.0)), ((0.0, 1.0, 0.0), (0.0, 1.0, 0.0))],
)
def test_vectors_that_make_no_plane_are_refused(lateral: tuple[float, ...], up: tuple[float, ...]) -> None:
    for wrong in ({"lateral": lateral, "up": up}, {"up": (0.0, 0.0, np.nan)}):
        with pytest.raises(MotionError, match="expected lateral and up to be orthogonal unit vectors"):
            replace(circles(), **wrong)


@pytest.mark.parametrize("count", [1, 3])
def test_every_test_has_a_panel_within_the_width_of_a_page(tmp_path: Path, count: int) -> None:
    path = report(tmp_path / "report.png", tests=[circles()] * count)
    columns = np.unique(pixels(path, BLUE)[:, 1])
    assert 1 + np.count_nonzero(np.diff(columns) > 150) == count  # the half of the right hand has no blue
    assert matplotlib.image.imread(path).shape[1] == 1900


def test_a_test_of_another_learner_is_beside_the_curve(tmp_path: Path) -> None:
    path = report(tmp_path / "report.png", tests=[circles()] * 3, beside=circles())
    rows, columns = pixels(path, BLUE).T
    row, column = end_of_curve(path)
    assert (rows > row).any()
    assert columns[rows > row].min() > column


def test_equal_input_has_equal_bytes_whatever_the_settings_of_the_user(tmp_path: Path) -> None:
    first = report(tmp_path / "first.png").read_bytes()
    with matplotlib.rc_context({"font.size": 20.0, "lines.linewidth": 5.0, "figure.facecolor": "red"}):
        second = report(tmp_path / "second.png").read_bytes()
    assert first == second
    assert b"tEXt" not in first  # no name of a program, no date


def end_of_curve(path: Path) -> np.ndarray:
    """Row and column of the dot at the end of the curve: nothing else is black seven pixels wide and high."""
    image = np.rint(matplotlib.image.imread(path)[..., :3] * 255)
    black = (image == 0.0).all(axis=2)
    found = np.argwhere(np.lib.stride_tricks.sliding_window_view(black, (7, 7)).all(axis=(2, 3)))
    assert len(found) > 0
    assert np.ptp(found, axis=0).max() <= 6  # a single dot
    return np.asarray(found.mean(axis=0))


@pytest.mark.parametrize(
    ("changes", "is_at_the_right"),
    [
        ({"errors_cm": [2.0]}, False),
        ({"errors_cm": [1.3] * 600, "teacher_cm": 1.3, "linear_cm": 1.3}, True),
        ({"paper_cm": 300.0}, True),
    ],
)
def test_short_flat_and_far_values_are_drawn(tmp_path: Path, changes: dict[str, Any], is_at_the_right: bool) -> None:
    assert (end_of_curve(report(tmp_path / "report.png", **changes))[1] > 1000) == is_at_the_right


def test_the_curve_ends_higher_for_a_larger_error(tmp_path: Path) -> None:
    better, worse = (report(tmp_path / f"{cm}.png", errors_cm=[9.0, cm]) for cm in (1.3, 6.0))
    assert end_of_curve(worse)[0] < end_of_curve(better)[0] - 100


def test_a_hand_held_still_is_drawn(tmp_path: Path) -> None:
    still = np.tile([0.32, 0.2, 0.76, 0.32, -0.2, 0.76], (SAMPLES, 1))
    test = MotionTest(
        "still",
        still,
        still.reshape(-1, 2, 3),
        hand_errors_of((0.1, 0.1), (0.1, 0.1)),
    )
    path = report(tmp_path / "report.png", tests=[test])
    label = pixels(path, BLUE)[:, 0].min()
    dots = [column for row, column in pixels(path, GREY) if label + 40 < row < label + 170]  # in the panel, not in text
    assert len(dots) > 100
    assert max(dots) - min(dots) > 1000  # one on the left, one on the right


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"tests": []}, "at least one test and one epoch, found 0 and 4"),
        ({"errors_cm": []}, "at least one test and one epoch, found 2 and 0"),
        ({"errors_cm": [3.0, float("nan")]}, "errors above zero, found nan cm"),
        ({"linear_cm": 0.0}, "errors above zero, found 0.0 cm"),
        ({"paper_cm": float("inf")}, "errors above zero, found inf cm"),
    ],
)
def test_what_cannot_be_drawn_is_one_line(tmp_path: Path, changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        report(tmp_path / "report.png", **changes)
    assert not (tmp_path / "report.png").exists()


def test_a_file_that_cannot_be_written_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"cannot write the report .*: No such file or directory"):
        report(tmp_path / "missing" / "report.png")


def with_nan(array: np.ndarray) -> np.ndarray:
    array[0] = np.nan
    return array


@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        ("targets", lambda a: a.reshape(-1, 2, 3), r"found \(64, 2, 3\) and \(64, 2, 3\)"),
        ("reached", lambda a: a[:-1], r"found \(64, 6\) and \(63, 2, 3\)"),
        ("targets", lambda a: a[0, 0], r"found \(\) and"),
        ("reached", with_nan, "finite positions"),
    ],
)
def test_a_test_with_paths_that_do_not_fit_is_refused(
    name: str, change: Callable[[np.ndarray], np.ndarray], message: str
) -> None:
    test = circles()
    with pytest.raises(MotionError, match=f"test 'circles': .*{message}"):
        replace(test, **{name: change(np.array(getattr(test, name)))})


def test_a_test_keeps_its_own_paths() -> None:
    targets, reached = np.zeros((3, 6)), np.zeros((3, 2, 3))
    test = MotionTest("still", targets, reached, hand_errors_of((0.0, 0.0), (0.0, 0.0)))
    targets[:] = reached[:] = 1.0
    assert not test.targets.any()
    assert not test.reached.any()
    with pytest.raises(ValueError, match="read-only"):
        test.targets[0] = 1.0


def test_drawing_needs_no_screen_and_no_global_state() -> None:
    program = "import sys, pipeline.views.figures; print('matplotlib.pyplot' in sys.modules)"
    result = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60)
    assert result.stdout.strip() == "False", result.stderr
