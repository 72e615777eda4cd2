"""A motion that leaves the boxes in which a robot explores is named in one line, and one within them is not."""

from pathlib import Path

import numpy as np
from small_inverse import ROBOT, taught
from typer.testing import CliRunner

from pipeline.cli.app import app
from pipeline.evaluation.outside_boxes import outside_boxes_text


def test_the_line_names_the_hands_that_leave_their_boxes_and_by_how_much() -> None:
    targets = np.stack([ROBOT.centres, ROBOT.centres, ROBOT.centres])
    assert outside_boxes_text(ROBOT, "still", targets) is None
    targets[1, 1, 0] -= ROBOT.boxes[1, 0] + 0.034
    assert outside_boxes_text(ROBOT, "reaching", targets) == (
        "reaching: has targets up to 3.4 cm outside the box of hand right; what was explored in the boxes alone is a "
        "guess there"
    )
    targets[2, 0, 2] += ROBOT.boxes[0, 2] + 0.01
    line = outside_boxes_text(ROBOT, "reaching", targets)
    assert line is not None
    assert "1.0 cm outside the box of hand left, 3.4 cm outside the box of hand right" in line


def test_evaluate_prints_it_beside_the_result(tmp_path: Path) -> None:
    taught().save(tmp_path / "c.npz")
    (x, y, z), (right_x, right_y, right_z) = ROBOT.centres.tolist()
    rows = "".join(f"{t},{x - t * 0.15},{y},{z},{right_x},{right_y},{right_z}\n" for t in (0, 1))
    (tmp_path / "away.csv").write_text(f"t,lx,ly,lz,rx,ry,rz\n{rows}")
    away = CliRunner().invoke(app, ["evaluate", str(tmp_path / "c.npz"), str(tmp_path / "away.csv"), "--json"])
    assert away.exit_code == 0
    assert away.stderr.startswith("away: has targets up to ")
    circles = CliRunner().invoke(app, ["evaluate", str(tmp_path / "c.npz"), "circles", "--json"])
    assert (circles.exit_code, circles.stderr) == (0, "")
