"""The picture of a calibration: drawn for controllers that expect deviations, refused for others in one line."""

from pathlib import Path

import pytest
from small_inverse import taught
from typer.testing import CliRunner

from pipeline.cli.app import app
from pipeline.evaluation.trials import evaluate_motion
from pipeline.views.calibration import calibration_figure, draw_calibration
from recorders.errors import ConfigError

PNG = b"\x89PNG\r\n\x1a\n"


def test_the_same_trial_gives_the_same_picture(tmp_path: Path) -> None:
    trial = evaluate_motion(taught(), "eight")
    for name in ("a.png", "b.png"):
        draw_calibration(tmp_path / name, trial)
    assert (tmp_path / "a.png").read_bytes()[:8] == PNG
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


def test_no_legend_lies_on_data() -> None:
    figure = calibration_figure(evaluate_motion(taught(), "eight"))
    figure.draw_without_rendering()
    for panel in figure.axes:
        legend = panel.get_legend()
        assert legend is not None
        assert legend.get_window_extent().y0 >= panel.get_window_extent().y1


def test_evaluate_draws_it(tmp_path: Path) -> None:
    taught().save(tmp_path / "c.npz")
    arguments = ["evaluate", str(tmp_path / "c.npz"), "eight", "--plot", str(tmp_path / "p.png"), "--json"]
    assert CliRunner().invoke(app, arguments).exit_code == 0
    assert (tmp_path / "p.png").read_bytes()[:8] == PNG


def test_a_controller_that_expects_none_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="--plot: expected a controller that knows how far off"):
        draw_calibration(tmp_path / "p.png", evaluate_motion(taught(samples=0), "eight"))
    assert not (tmp_path / "p.png").exists()


def test_a_file_that_cannot_be_written_is_one_clear_line(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="cannot write"):
        draw_calibration(tmp_path / "none" / "p.png", evaluate_motion(taught(), "eight"))
