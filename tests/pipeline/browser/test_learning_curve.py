"""Learning from logs as the page does it: the state that `train` comes to, and errors on the way that fall."""

import json
import math

import numpy as np
import pytest

from pipeline.browser.teaching.curve import Curve
from pipeline.browser.teaching.log_learning import learn
from pipeline.learner.controller import Controller
from pipeline.learner.registry import default_config
from pipeline.resources import data_path
from pipeline.training.trainer import train
from recorders.errors import LogError
from recorders.writing.writer import LogWriter

LOGS = {
    "forward-inverse": data_path("golden", "forward_inverse", "volume_50.mcap"),
    "reservoir": data_path("golden", "circles", "circles_40.mcap"),
}


@pytest.mark.parametrize("rule", LOGS)
def test_what_is_learned_is_what_train_learns_and_the_error_falls(rule, tmp_path):
    shown = []
    out = tmp_path / "learned.npz"
    learn(rule, out, [LOGS[rule]], lambda *line: shown.append(line))
    config = default_config(rule)
    trained = train([LOGS[rule]], schedule=config.schedule(), config=config)
    assert Controller.load(out).digest == trained.result()["digest"]
    passes = [at for at, _, _ in shown]
    assert passes == sorted(set(passes))
    assert {of for _, of, _ in shown} == {config.schedule().epochs * config.schedule().cycles}
    assert passes[-1] == shown[0][1]
    assert len(passes) > 1
    first, last = shown[0][2], shown[-1][2]
    assert sum(last) < 0.5 * sum(first)
    assert sum(last) / len(last) == pytest.approx(trained.errors_cm[-1], rel=1e-9)
    assert json.loads(json.dumps(shown[0]))


def test_a_log_without_a_robot_teaches_nothing(tmp_path):
    log = tmp_path / "empty.mcap"
    with LogWriter(log, manifest={}):
        pass
    with pytest.raises(LogError, match="expected"):
        learn("forward-inverse", tmp_path / "out.npz", [log], lambda *line: None)
    assert not (tmp_path / "out.npz").exists()


def test_a_curve_takes_what_is_a_number_and_comes_later():
    curve = Curve(2, "passes")
    assert (curve.last_at, curve.last_cm) == (None, None)
    for at, hands_cm in (
        (1.0, (4.0, 2.0)),
        (0.5, (9.0, 9.0)),
        (2.0, (math.nan, 1.0)),
        (3.0, (1.0,)),
        (4.0, (1.0, 0.5)),
    ):
        curve.add(at, hands_cm)
    assert curve.points(10).tolist() == [[1.0, 4.0, 2.0], [4.0, 1.0, 0.5]]
    assert (curve.last_at, curve.last_cm) == (4.0, 0.75)


def test_a_curve_of_a_long_time_keeps_its_ends_and_no_more_than_can_be_seen():
    curve = Curve(1, "s")
    for at in range(10_000):
        curve.add(float(at), (1.0 / (1.0 + at),))
    points = curve.points(10_000)
    assert len(points) <= 4096
    assert points[[0, -1], 0].tolist() == [0.0, 9_999.0]
    few = curve.points(50)
    assert 50 <= len(few) <= 102
    assert few[-1, 0] == 9_999.0
    assert (np.diff(few[:, 0]) > 0).all()
