"""What somebody showed is sampled, turned and placed, and becomes an episode that says where it is from."""

import hashlib
import json
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from shown import RIGHT, ROBOT, check_is_line, line_of, shown_right, write_csv

from pipeline.exploration.demonstration import MAX_SAMPLES, DemonstrationConfig, demonstrate, to_motion
from pipeline.exploration.hand_paths import DemonstratedPaths, read_csv_paths
from pipeline.exploration.pose_track import HandPath
from pipeline.learner.rules.reservoir.config import LearnerConfig
from pipeline.motions.smoothing import peak_jerk, smoothed
from pipeline.samples.pairs import read_samples
from pipeline.training.trainer import train
from recorders.errors import ConfigError, MotionError
from recorders.messages import topics
from recorders.reading.reader import LogReader
from replay.sources.schedule import Schedule

AS_IS = DemonstrationConfig(align="as-is")


def test_uneven_times_become_10_hz_and_the_hand_that_is_not_shown_stays_still() -> None:
    times_s = np.concatenate([[0.0], np.sort(np.random.default_rng(1).uniform(0.01, 0.99, 40)), [1.0]])
    check_is_line(to_motion(ROBOT, shown_right(times_s, line_of(times_s)), config=AS_IS), samples=11)


def test_two_hands_are_sampled_while_both_are_shown() -> None:
    early, late = np.arange(0.0, 2.01, 0.05), np.arange(0.5, 3.01, 0.07)
    paths = {"left": HandPath(early, line_of(early)), "right": HandPath(late, line_of(late))}
    motion = to_motion(ROBOT, DemonstratedPaths("both", paths, {}), config=AS_IS)
    assert len(motion) == 16
    np.testing.assert_allclose(motion.targets[:, 0], line_of(0.5 + motion.times_s), atol=2e-9)
    np.testing.assert_allclose(motion.targets[:, 1], motion.targets[:, 0], atol=2e-9)


def test_a_path_is_centred_and_scaled_about_its_middle() -> None:
    times_s, points = np.arange(3.0), np.array([[5.0, 10.0, 0.0], [5.0, 30.0, 8.0], [5.0, 20.0, 4.0]])
    config = DemonstrationConfig(hz=1.0, scale=0.01)
    placed = to_motion(ROBOT, shown_right(times_s, points), config=config)
    np.testing.assert_allclose(placed.targets[:, 1] - RIGHT, [[0, -0.1, -0.04], [0, 0.1, 0.04], [0, 0, 0]], atol=1e-9)
    scaled = to_motion(
        ROBOT, shown_right(times_s, points), config=DemonstrationConfig(hz=1.0, scale=0.01, align="as-is")
    )
    np.testing.assert_allclose(scaled.targets[:, 1], [[5, 19.9, 3.96], [5, 20.1, 4.04], [5, 20, 4]], atol=1e-9)


def test_what_is_drawn_on_a_screen_is_turned_into_the_robots_plane() -> None:
    """Rightwards on the screen is to the robot's right, -y; upwards is up; out of the screen is towards the robot."""
    times_s, points = np.arange(4.0), np.array([[0, 0, 0], [0.1, 0, 0], [0.1, 0.2, 0], [0.1, 0.2, 0.06]])
    config = DemonstrationConfig(hz=1.0, plane=("-x", "y"))
    moves = np.diff(to_motion(ROBOT, shown_right(times_s, points), config=config).targets[:, 1], axis=0)
    np.testing.assert_allclose(moves, [[0, -0.1, 0], [0, 0, 0.2], [-0.06, 0, 0]], atol=1e-9)
    flat = DemonstrationConfig(hz=1.0, plane=("-x", "y"), project_to_plane=True)
    motion = to_motion(ROBOT, shown_right(times_s, points), config=flat)
    np.testing.assert_allclose(motion.targets[:, 1][:, 0], RIGHT[0], atol=1e-9)
    np.testing.assert_allclose(np.diff(motion.targets[:, 1], axis=0)[:2], moves[:2], atol=1e-9)


def tracked(noise_m: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A circle at 30 Hz, uneven, with the noise of a tracker: times, noisy points, true ones."""
    draw = np.random.default_rng(3)
    times_s = np.arange(0.0, 4.0, 1 / 30) + draw.uniform(-0.005, 0.005, 120)
    true = 0.1 * np.stack([np.zeros_like(times_s), np.cos(1.5 * times_s), np.sin(1.5 * times_s)], axis=1)
    return times_s, true + draw.normal(0.0, noise_m, true.shape), true


def test_a_trackers_noise_is_smoothed_away_and_what_is_smooth_stays() -> None:
    for noise_m, bound_m in ((0.003, 0.002), (0.0, 1e-5)):
        times_s, noisy, true = tracked(noise_m)
        even_s, smooth, window_s = smoothed(times_s, noisy, 0.3)
        assert window_s == pytest.approx(0.27, abs=0.05)
        error_m = smooth - np.stack([np.interp(even_s, times_s, true[:, axis]) for axis in range(3)], axis=1)
        assert np.sqrt((error_m**2).mean()) < bound_m + 2e-4  # the true path is interpolated linearly
    assert smoothed(np.arange(10.0), np.eye(10, 3), 0.3)[2] == 0.0  # too sparse
    np.testing.assert_array_equal(smoothed(np.arange(10.0), np.eye(10, 3), 0.3)[1], np.eye(10, 3))


@pytest.mark.parametrize(("period_s", "hz"), [(0.1, 10.0), (0.3, 50.0)])  # a wider window helps; none can
def test_a_leap_is_smoothed_or_slowed_until_the_robot_can_follow(period_s: float, hz: float, tmp_path: Path) -> None:
    times_s = np.arange(11) * period_s
    points = np.where(times_s[:, None] < 5.5 * period_s, 0.0, [0.0, 0.2, 0.2]) + RIGHT - [0.0, 0.1, 0.1]
    config, shown = replace(AS_IS, hz=hz), shown_right(times_s, points)
    result = demonstrate(ROBOT, shown, config=config, seed=0, out=tmp_path / "leap.mcap")
    as_shown = to_motion(ROBOT, shown, config=replace(config, smooth_s=0.0))
    assert peak_jerk(as_shown.targets, 1 / hz) > result.smoothing.jerk_limit_m_s3 >= result.smoothing.jerk_m_s3
    assert len(as_shown) == round(10 * period_s * hz) + 1
    assert (result.smoothing.slowed > 1.0) == (result.smoothing.windows_s["right"] == 0.0) == (period_s == 0.3)
    assert result.duration_s == pytest.approx(10 * period_s * result.smoothing.slowed, abs=1.5 / hz)
    manifest = LogReader(tmp_path / "leap.mcap").manifest["demonstration"]
    assert manifest["smooth_s"] == 0.3
    assert manifest["smoothing"] == asdict(result.smoothing)


@pytest.mark.parametrize(
    ("times_s", "message"),
    [
        ([0.0, 0.05], r"expected at least 0.1 s, found 0.05 s"),
        ([0.0, 1e9], rf"expected at most {MAX_SAMPLES} samples at 10 Hz, found a first and last time 1e\+09 s apart"),
    ],
)
def test_times_that_make_no_motion_are_refused(times_s: list[float], message: str) -> None:
    with pytest.raises(MotionError, match=message):
        to_motion(ROBOT, shown_right(np.array(times_s), np.zeros((2, 3))), config=AS_IS)


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"hz": 0.0}, "hz: expected above 0, found 0"),
        ({"scale": float("nan")}, "scale: expected above 0, found nan"),
        ({"smooth_s": 1.5}, "smooth: expected 0 to 1 s, found 1.5"),
        ({"align": "left"}, "align: expected one of centre, as-is, found 'left'"),
        ({"on_unreachable": "bend"}, "on_unreachable: expected one of refuse, clip, skip, keep, found 'bend'"),
        ({"plane": ("x", "-x")}, "plane: expected two different axes, such as -x and y, found x,-x"),
        ({"plane": ("x", "up")}, "plane: expected two different axes"),
    ],
)
def test_parameters_out_of_range_are_refused(parameters: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        DemonstrationConfig(**parameters)


@pytest.fixture(scope="module")
def episode(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("demonstration")
    times_s = np.arange(0.0, 1.01, 0.03)
    shown = read_csv_paths(write_csv(folder / "line.csv", "t,rx,ry,rz", times_s, line_of(times_s)), ROBOT.hand_names)
    demonstrate(ROBOT, shown, config=AS_IS, seed=4, out=folder / "line.mcap")
    return folder / "line.mcap"


def test_the_episode_is_like_an_explored_one_and_trains(episode: Path) -> None:
    samples = read_samples(episode)
    assert len(samples.targets) == 10
    np.testing.assert_allclose(samples.targets[:, 3:], line_of(0.1 * np.arange(10)), atol=2e-9)
    names = set(LogReader(episode).topics)
    assert {topics.SAMPLE_JOINTS, topics.RIGHT_MEASURED, topics.JOINT_STATES, topics.TF} <= names
    assert train([episode], schedule=Schedule(epochs=1), config=LearnerConfig(reservoir=20)).result()["ticks"] > 0


def test_the_manifest_says_where_it_came_from_and_what_was_done(episode: Path) -> None:
    manifest = LogReader(episode).manifest
    assert (manifest["kind"], manifest["seed"], manifest["motion"]["name"]) == ("exploration", 4, "line")
    source = manifest["demonstration"]
    assert source["sha256"] == hashlib.sha256((episode.parent / "line.csv").read_bytes()).hexdigest()
    assert (source["kind"], source["name"], source["hands"]) == ("csv", "line.csv", ["right"])
    assert (source["hz"], source["place"], source["scale"], source["unreachable"]) == (10.0, "as-is", 1.0, "refuse")
    assert source["out_of_reach"]["samples"] == 0
    assert str(episode.parent) not in json.dumps(manifest)


def test_the_same_demonstration_gives_the_same_bytes(episode: Path, tmp_path: Path) -> None:
    shown = read_csv_paths(episode.parent / "line.csv", ROBOT.hand_names)
    done: list[float] = []
    made = demonstrate(ROBOT, shown, config=AS_IS, seed=4, out=tmp_path / "again.mcap", progress=done.append)
    assert made.path.read_bytes() == episode.read_bytes()
    assert made.duration_s == pytest.approx(0.9)
    assert made.peak_m_s == pytest.approx(np.hypot(0.1, 0.05))
    assert made.longest_gap_s == pytest.approx(0.03)
    assert done[-1] == 1.0


@pytest.mark.parametrize(("choice", "ticks"), [("clip", 7), ("skip", 4), ("keep", 7)])
def test_samples_out_of_reach_are_handled_as_chosen(tmp_path: Path, choice: str, ticks: int) -> None:
    times_s = 0.1 * np.arange(6)
    points = RIGHT + np.outer([0, 1, 2, 9, 9, 9], [0.0, 0.0, 0.1])
    config = DemonstrationConfig(align="as-is", on_unreachable=choice)
    made = demonstrate(ROBOT, shown_right(times_s, points), config=config, seed=0, out=tmp_path / "far.mcap")
    assert (made.ticks, made.out_of_reach.samples, made.out_of_reach.hand) == (ticks, 3, "right")
    assert LogReader(made.path).manifest["demonstration"]["out_of_reach"]["handled"] == choice
