"""Rules compared on the same samples: costs and errors of each, rows of what is missing, parts of the error, bounds."""

import re
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from episodes import write_episode
from small_paper import small_comparison, small_paper

from pipeline.evaluation.trials import evaluate_motion
from pipeline.exploration.sources import volume as volume_source
from pipeline.learner.controller import Controller
from pipeline.learner.registry import default_config
from pipeline.motions.names import PATTERNS, drawings
from pipeline.paper.comparison import rules
from pipeline.paper.comparison.error_parts import error_parts
from pipeline.paper.comparison.explorations import TAUGHT, explore_and_learn
from pipeline.paper.comparison.page import comparison_texts
from pipeline.paper.comparison.results import Figure
from pipeline.paper.comparison.rules import (
    BASELINES,
    NOT_COMPARED,
    OUR_RULE,
    PAPERS_RULE,
    answer_of,
    compare_rules,
    errors_of,
    motions_of,
    step_costs,
)
from pipeline.paper.report import write_report
from pipeline.robot.config import load_robot
from pipeline.robot.kinematics import Kinematics
from pipeline.training.trainer import train
from recorders.messages.message_types import Message, PoseStamped
from recorders.messages.topics import LEFT_MEASURED, RIGHT_MEASURED, SAMPLE_JOINTS

ROBOT = load_robot("asimo")


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_episode(tmp_path_factory.mktemp("compared") / "log.mcap", samples=20, change=_with_hands)


def _with_hands(tick: int, topic: str, message: Message) -> list[tuple[str, Message]]:
    """Add hands as reached to joints."""
    if topic != SAMPLE_JOINTS:
        return [(topic, message)]
    left, right = Kinematics(ROBOT).hands(message.position)
    stamp = message.stamp_ns
    return [
        (topic, message),
        (LEFT_MEASURED, PoseStamped(stamp, left)),
        (RIGHT_MEASURED, PoseStamped(stamp, right)),
    ]


@pytest.fixture(scope="module")
def network(log: Path) -> Controller:
    settings = default_config()
    return train([log], schedule=settings.schedule(2), config=settings).controller()


@pytest.fixture(scope="module")
def model(log: Path) -> Controller:
    settings = default_config("forward-inverse")
    return train([log], schedule=settings.schedule(), config=settings).controller()


def test_every_rule_learns_what_is_there_and_what_is_not_installed_is_named(
    log: Path, model: Controller, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("sklearn", "sklearn.kernel_ridge", "sklearn.neural_network"):
        monkeypatch.setitem(sys.modules, name, None)
    compared = {one.name: one for one in compare_rules([log], motions_of(ROBOT, (*PATTERNS, *drawings())), epochs=1)}
    assert list(compared) == [PAPERS_RULE, *BASELINES, OUR_RULE]
    for name, one in compared.items():
        if name.startswith("scikit-learn"):
            assert one.errors == ()
        else:
            assert one.errors[0]["circles"].mean_cm > 0.0
            assert one.tick_us > 0.0
            assert one.command_us > 0.0
    ours = compared[OUR_RULE].errors[0]["circles"]
    assert ours.mean_cm == pytest.approx(evaluate_motion(model, "circles").errors.mean_cm, rel=1e-9)
    text = comparison_texts(replace(small_comparison(log), rules=tuple(compared.values())))["rules"]
    assert text.count(NOT_COMPARED) == 2


def test_another_package_that_is_missing_is_not_passed_over(log: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fit(targets, joints, seed):
        raise ModuleNotFoundError("no module named elsewhere", name="elsewhere")

    monkeypatch.setattr(rules, "BASELINES", {"broken": fit})
    with pytest.raises(ModuleNotFoundError, match="elsewhere"):
        list(compare_rules([log], motions_of(ROBOT, ["circles"]), epochs=1))


def test_a_held_target_matters_to_a_rule_with_a_delay_alone(network: Controller, model: Controller) -> None:
    targets = motions_of(ROBOT, ["eight"])["eight"]
    np.testing.assert_array_equal(answer_of(model)(targets), answer_of(model, hold=10)(targets))
    held = answer_of(network, hold=10)(targets)
    learner = network.learner()
    step_by_step = [learner.predict(np.repeat(target[np.newaxis], 10, axis=0))[-1] for target in targets]
    np.testing.assert_array_equal(held, np.array(step_by_step)[:, -held.shape[1] :])
    assert np.abs(held - answer_of(network)(targets)).max() > 1e-6


def test_causes_of_the_error_are_taken_away_one_by_one(log: Path, network: Controller) -> None:
    motions = motions_of(ROBOT, ["circles", "eight"])
    found = {part.name: part for part in error_parts([network] * 2, log, log, robot=ROBOT, motions=motions, epochs=2)}
    assert list(found) == [
        "papers_rule",
        "held",
        "reached",
        "reached_held",
        "covered",
        "covered_held",
        "linear",
        "linear_reached",
    ]
    assert len(found["held"].errors) == 2
    assert found["held"].errors[0] == errors_of(ROBOT, answer_of(network, hold=10), motions)
    assert found["linear"].errors != found["linear_reached"].errors
    assert found["reached"].errors == found["covered"].errors  # from one log here


def test_compiled_steps_are_timed(log: Path) -> None:
    costs = step_costs(log)
    assert min(costs.learning_us, costs.command_us, costs.papers_us) > 0.0


def test_a_figure_has_students_interval_from_two_seeds_on() -> None:
    figure = Figure.of([1.0, 2.0, 3.0])
    assert (figure.mean_cm, figure.std_cm) == (2.0, 1.0)
    assert figure.interval_cm == pytest.approx(2.4841, abs=1e-4)
    assert str(figure) == "2.000 ± 1.000"
    assert Figure.of([1.5]).to_dict() == {"mean_cm": 1.5, "std_cm": 0.0, "interval_cm": None}


def test_bounds_are_of_means_over_seeds_and_of_the_worst_column(tmp_path: Path) -> None:
    paper = small_paper(tmp_path)
    comparison = paper.comparison
    assert all(check.holds for check in comparison.checks())
    first = comparison.explored[0]
    worse = replace(first.errors["right_hand_house"], hands_cm={"left": 0.01, "right": 0.15})
    far = replace(first, errors={**first.errors, "right_hand_house": worse})
    failing = replace(comparison, explored=(far, *comparison.explored[1:]))
    failed = [check for check in failing.checks() if not check.holds]
    assert [(check.claim, check.found) for check in failed] == [
        (
            "forward-inverse, 120 s at 5 Hz, with a teacher: each hand of each drawing: at most 0.08 cm",
            "0.085 cm",
        )
    ]
    report = write_report(replace(paper, comparison=failing), tmp_path).read_text(encoding="utf-8")
    assert re.search(
        r'each hand of each drawing: at most 0\.08 cm</td><td[^>]*>0\.085 cm</td><td><span class="fails">', report
    )


def test_the_page_has_figures_commands_and_what_is_missing(tmp_path: Path) -> None:
    texts = comparison_texts(small_comparison(tmp_path / "log.mcap"))
    assert "<td>iCub: 120 s at 5 Hz</td>" in texts["explored"]
    assert "not compared: install robots" in texts["explored"]
    assert "0.015 ± 0.007" in texts["explored"]
    assert "-0.049 to 0.079" in texts["explored"]
    assert texts["rules"].count(NOT_COMPARED) == 1
    assert "held &amp; more" in texts["parts"]
    assert (
        "reenact explore --no-teacher --duration 30 --tick-rate 25 --robot asimo --seed SEED "
        "--out again-self_taught_30s-SEED.mcap"
    ) in texts["explored_commands"]


def test_goal_babbling_stands_beside_the_rule_at_equal_robot_time(tmp_path: Path) -> None:
    comparison = small_comparison(tmp_path / "log.mcap")
    table = comparison_texts(comparison)["alone"]
    assert re.findall(r"<td>(forward-inverse|goal babbling)[^<]*</td><td[^>]*>(\d+ s)</td>", table) == [
        (rule, length) for length in ("120 s", "30 s") for rule in ("forward-inverse", "goal babbling")
    ]
    assert table.count("1.500 ± 0.000") == 2 * 4
    found = comparison.summary()["goal_babbling"]
    assert found["self_taught_30s"]["circles"] == {"mean_cm": 1.5, "std_cm": 0.0, "interval_cm": 0.0}


def test_both_teachers_stand_in_the_report(tmp_path: Path) -> None:
    comparison = small_comparison(tmp_path / "log.mcap")
    rows = re.findall(r"<tr>(.*?)</tr>", comparison_texts(comparison)["teachers"])[-2:]
    assert [re.findall(r"<td[^>]*>(.*?)</td>", row) for row in rows] == [
        ["right hand drawing", "rates", "2.500", "0.250", "0.30", "0.0200", "5.85", "41"],
        ["right hand drawing", "qp", "2.250", "0.125", "0.60", "0.0300", "–", "806"],
    ]
    assert [one["teacher"] for one in comparison.summary()["teachers"]] == ["rates", "qp"]


def test_an_exploration_that_is_refused_is_a_row_with_its_reason(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(volume_source, "_DRAWS", 1)  # found out sooner
    far = replace(TAUGHT, robot=str(robot_out_of_reach(tmp_path)), duration_s=1.0, motions=("circles",))
    one = explore_and_learn(far, seed=0, folder=tmp_path)
    assert one.errors == {}
    assert re.match(r"robot 'asimo': found no way for hands that keep 3 cm from its body", one.refused)

    paper = small_paper(tmp_path)
    robots_first, *others = (found for found in paper.comparison.explored if found.exploration.name == "icub")
    refused = replace(robots_first, errors={}, refused="hands & body touch")
    explored = tuple(refused if found is robots_first else found for found in paper.comparison.explored)
    comparison = replace(paper.comparison, explored=explored)
    text = comparison_texts(comparison)["explored"]
    assert f"seed {refused.seed} was refused: hands &amp; body touch" in text
    assert comparison.by_exploration()[refused.exploration]["circles"].mean_cm == others[0].errors["circles"].mean_cm
    assert comparison.summary()["refused"] == [{"exploration": "icub", "seed": 1, "reason": "hands & body touch"}]
    failed = [check for check in comparison.checks() if not check.holds]
    assert [(check.claim, check.found) for check in failed] == [
        ("iCub: 120 s at 5 Hz: seed 1 explores", "refused: hands & body touch")
    ]


def test_the_report_goes_on_where_every_exploration_is_refused(tmp_path: Path) -> None:
    whole = small_comparison(tmp_path / "log.mcap")
    explored = tuple(replace(one, errors={}, refused="too near") for one in whole.explored)
    comparison = replace(whole, explored=explored, rules=(), parts=(), costs=None)
    texts = comparison_texts(comparison)
    assert texts["explored"].count("was refused: too near") == len(explored)
    assert texts.keys() == comparison_texts(whole).keys()
    assert comparison.summary()["learning_step_us"] is None


def robot_out_of_reach(folder: Path) -> Path:
    """Write asimo with boxes that its hands do not reach."""
    robot = folder / "far"
    robot.mkdir()
    (robot / "robot.urdf").write_text(ROBOT.urdf_text)
    (robot / "robot.toml").write_text(ROBOT.toml_text.replace("centre = [0.32,", "centre = [0.92,"))
    return robot
