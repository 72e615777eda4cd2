"""The rule `forward-inverse`: it does all that a rule does, and it reaches what it is to reach."""

from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest
from episodes import write_plain_episode

from pipeline.evaluation.trials import evaluate_motion
from pipeline.learner.body import Body, any_body, body_of
from pipeline.learner.contract import LearningRuleContract
from pipeline.learner.controller import Controller
from pipeline.learner.controller_diff import first_difference
from pipeline.learner.registry import config_from_dict, config_to_dict
from pipeline.learner.rules import forward_inverse
from pipeline.learner.rules.forward_inverse.config import ForwardInverseConfig
from pipeline.learner.rules.forward_inverse.features import MAX_FEATURES
from pipeline.learner.rules.forward_inverse.learner import ForwardInverseLearner
from pipeline.learner.state import state_digest
from pipeline.robot.config import load_robot
from pipeline.robot.kinematics import Kinematics
from pipeline.serving.served_controller import ServedController
from recorders.cdr.codec import decode_as
from recorders.errors import ConfigError, ControllerError
from recorders.messages.message_types import PoseStamped
from recorders.messages.topics import hand_target
from recorders.reading.reader import LogReader

ROBOT = load_robot("asimo")
BODY = body_of(ROBOT)
TARGETS = [hand_target(hand) for hand in ("left", "right")]
CENTRE = np.concatenate([ROBOT.input_centre, ROBOT.comfort])


class TestForwardInverse(LearningRuleContract):
    rule = forward_inverse.RULE
    settings: ClassVar[dict[str, int | float]] = {"degree": 2}


class TestForgetting(LearningRuleContract):
    rule = forward_inverse.RULE
    settings: ClassVar[dict[str, int | float]] = {"degree": 1, "forgetting": 0.999}


class TestResidual(LearningRuleContract):
    rule = forward_inverse.RULE
    settings: ClassVar[dict[str, int | float]] = {"degree": 1, "residual_degree": 1}


def learner_of(**settings: int | float) -> ForwardInverseLearner:
    config = ForwardInverseConfig(**settings).with_body(BODY)
    return ForwardInverseLearner(config, input_centre=ROBOT.input_centre, output_centre=CENTRE)


def postures(count: int, *, seed: int, spread: float = 0.12) -> np.ndarray:
    """Joints about the comfort posture, as far as a part of their ranges."""
    span = ROBOT.upper - ROBOT.lower
    drawn = ROBOT.comfort + spread * span * np.random.default_rng(seed).uniform(-1.0, 1.0, (count, len(span)))
    return np.clip(drawn, ROBOT.lower, ROBOT.upper)


def samples(joints: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Hands where the joints bring them, and what a step takes beside them."""
    hands = Kinematics(ROBOT).hands_along(joints).reshape(len(joints), 6)
    return hands, np.concatenate([hands, joints], axis=1)


def errors_cm(learner: ForwardInverseLearner, targets: np.ndarray) -> np.ndarray:
    """Distance of each hand from its target at the commands, shape (n, 2)."""
    hands = Kinematics(ROBOT).hands_along(learner.predict(targets)[:, 6:])
    return np.linalg.norm(hands - targets.reshape(-1, 2, 3), axis=2) * 100.0


@pytest.fixture(scope="module")
def taught() -> ForwardInverseLearner:
    """A learner of degree 3 after one pass over 1500 postures."""
    learner = learner_of()
    learner.step(*samples(postures(1500, seed=0)), learning=True)
    return learner


def test_the_body_is_what_the_robots_joints_move() -> None:
    names = [{BODY.joints[place] for place in places} for places in BODY.moves]
    both = {"hip_height", "hip_yaw", "hip_pitch", "hip_roll"}
    assert names[0] & names[1] == both
    assert [len(chain) for chain in names] == [9, 9]
    assert "head_pan" not in names[0] | names[1]


def test_features_follow_from_the_body() -> None:
    config = ForwardInverseConfig().with_body(BODY)
    found = {model.name: (len(model.variables), model.features, model.outputs) for model in config.models}
    assert found == {"inverse": (6, 84, 15), "forward_left": (9, 220, 3), "forward_right": (9, 220, 3)}
    assert config.notes() == ()


def test_a_model_of_too_many_features_has_a_lower_degree_and_says_so() -> None:
    config = ForwardInverseConfig()  # no body: all of 15 joints may move both hands
    assert {model.name: model.degree for model in config.models}["forward_left"] == 2
    assert all(model.features <= MAX_FEATURES for model in config.models)
    assert any("forward left: degree 2 in place of 3, which would take 816 features" in line for line in config.notes())
    with pytest.raises(ConfigError, match="at most 500 features of model forward_left, found 601"):
        ForwardInverseConfig(inputs=6, outputs=606)


def test_one_pass_brings_the_hands_to_targets_that_were_never_trained(taught: ForwardInverseLearner) -> None:
    targets, _ = samples(postures(200, seed=1, spread=0.06))
    found = errors_cm(taught, targets)
    assert found.mean() < 0.1
    assert errors_cm(learner_of(), targets).mean() > 10.0 * found.mean()


def test_the_newton_step_is_what_brings_them_there(taught: ForwardInverseLearner) -> None:
    targets, _ = samples(postures(200, seed=1, spread=0.06))
    explained = taught.explain(targets)
    without = Kinematics(ROBOT).hands_along(explained.estimate) - targets.reshape(-1, 2, 3)
    assert np.linalg.norm(without, axis=2).mean() * 100.0 > 3.0 * errors_cm(taught, targets).mean()
    assert np.array_equal(explained.joints, taught.predict(targets)[:, 6:])
    np.testing.assert_allclose(explained.hands, targets, atol=0.002)


def test_a_command_depends_on_its_target_alone(taught: ForwardInverseLearner) -> None:
    targets, _ = samples(postures(30, seed=2))
    digest, together = state_digest(taught.state()), taught.predict(targets)
    assert np.array_equal(np.concatenate([taught.predict(row[np.newaxis]) for row in targets[::-1]])[::-1], together)
    assert state_digest(taught.state()) == digest


def test_limits_are_kept_wherever_the_target_is(taught: ForwardInverseLearner) -> None:
    targets = ROBOT.input_centre + np.random.default_rng(3).uniform(-3.0, 3.0, (200, 6))
    joints = taught.predict(targets)[:, 6:]
    assert ((ROBOT.lower <= joints) & (joints <= ROBOT.upper)).all()
    assert ((joints == ROBOT.lower) | (joints == ROBOT.upper)).any()


def test_an_untaught_learner_commands_the_comfort_posture() -> None:
    learner = learner_of()
    targets, _ = samples(postures(5, seed=4))
    assert np.array_equal(learner.predict(targets)[:, 6:], np.tile(ROBOT.comfort, (5, 1)))
    assert np.isinf(learner.deviations(targets)).all()
    assert all(np.isinf(found).all() for found in learner.model_errors().values())


def test_it_knows_where_it_has_been(taught: ForwardInverseLearner) -> None:
    near, _ = samples(postures(50, seed=5, spread=0.02))
    far = near + 0.6
    deviations = taught.deviations(near)
    assert deviations.shape == (50, 2)
    assert np.median(taught.deviations(far)) > 10.0 * np.median(deviations)
    assert 0.2 < np.median(errors_cm(taught, near)) / (np.median(deviations) * 100.0) < 5.0


def test_what_it_expects_to_err_is_what_it_errs(taught: ForwardInverseLearner) -> None:
    """On postures drawn as those that it was taught, and more so on the outermost of them."""
    joints = postures(300, seed=12)
    hands, deviations = taught._expect(joints)  # of the postures themselves: no command comes in between
    errors = np.linalg.norm((hands - samples(joints)[0]).reshape(-1, 2, 3), axis=2)
    assert 0.5 < (errors <= deviations).mean() < 0.8
    assert 0.6 < np.sqrt((deviations**2).mean() / (errors**2).mean()) < 1.5
    outer = deviations > np.quantile(deviations, 0.8)
    assert errors[outer].mean() > 1.5 * errors[~outer].mean()
    middle, usual = taught._expect(ROBOT.comfort[np.newaxis])[1][0], taught.usual_deviations()
    assert (middle < usual).all()
    assert np.isinf(learner_of().usual_deviations()).all()


def test_a_residual_explains_what_changed_before_the_models_do(taught: ForwardInverseLearner) -> None:
    """Hands that are all 2 cm elsewhere: ten samples are enough, and the models stay nearly what they were."""
    config = taught.config.adaptive()
    learner = ForwardInverseLearner(config, input_centre=ROBOT.input_centre, output_centre=CENTRE)
    learner.load_state({**learner.state(), **taught.state()})
    targets, _ = samples(postures(50, seed=13, spread=0.06))
    assert np.array_equal(learner.predict(targets), taught.predict(targets))
    joints = postures(10, seed=14, spread=0.06)
    hands = samples(joints)[0] + 0.02
    learner.step(hands, np.concatenate([hands, joints], axis=1), learning=True)
    reached = samples(learner.predict(targets)[:, 6:])[0] + 0.02
    assert np.linalg.norm((reached - targets).reshape(-1, 2, 3), axis=2).mean() < 0.005
    explained = learner.explain(targets)
    np.testing.assert_allclose(explained.hands, targets, atol=0.002)
    moved = np.abs(learner.linearise(ROBOT.comfort)[0] - taught.linearise(ROBOT.comfort)[0])
    assert moved.max() < 0.005


def test_errors_of_the_models_are_from_before_each_update() -> None:
    learner, (u, d) = learner_of(degree=1), samples(postures(1, seed=6))
    learner.step(u, d, learning=True)
    half = (ROBOT.upper - ROBOT.lower) / 2.0
    np.testing.assert_allclose(learner.state()["inverse_errors"][-1] > 0.0, True)
    share = np.cbrt(learner.state()["inverse_errors"][-1])
    expected = np.abs(d[0, 6:] - ROBOT.comfort) * np.sqrt(share)
    np.testing.assert_allclose(learner.model_errors()["inverse"], expected, rtol=1e-12, atol=0)
    np.testing.assert_allclose(learner.model_errors()["inverse"] / half, expected / half, rtol=1e-12)


def test_what_stands_before_the_joints_in_d_does_not_count() -> None:
    one, other, (u, d) = learner_of(degree=1), learner_of(degree=1), samples(postures(20, seed=7))
    one.step(u, d, learning=True)
    other.step(u, np.concatenate([np.zeros((20, 6)), d[:, 6:]], axis=1), learning=True)
    assert state_digest(one.state()) == state_digest(other.state())


def test_elements_are_named_by_feature_and_output() -> None:
    config = ForwardInverseConfig().with_body(BODY)
    assert config.element_name("forward_right_weights", (0, 2)) == "forward_right_weights[1, z]"
    assert config.element_name("forward_right_weights", (1, 0)) == "forward_right_weights[hip_height, x]"
    assert config.element_name("inverse_weights", (7, 14)) == "inverse_weights[left_x^2, head_pan]"
    assert config.element_name("inverse_covariance", (84,)) == "inverse_covariance[left_x, left_x]"
    assert config.element_name("inverse_errors", (15,)) == "inverse_errors[sum of weights]"
    assert config.element_name("forward_left_leverage", (4,)) == "forward_left_leverage[y*leverage]"
    assert config.element_name("forward_left_leverage", (9,)) == "forward_left_leverage[samples]"
    residual = config.adaptive()
    assert residual.element_name("residual_weights", (7, 5)) == "residual_weights[left_x^2, right_z]"


def test_diff_names_the_element_and_the_part_of_the_body() -> None:
    learner = learner_of(degree=1)
    learner.step(*samples(postures(20, seed=8)), learning=True)
    a = controller_of(learner)
    learner.step(*samples(postures(1, seed=9)), learning=True)
    assert str(first_difference(a, controller_of(learner))).startswith("inverse_weights[1, hip_height]: ")
    state = a.state["forward_right_weights"].copy()
    state[1, 0] += 1e-9
    other = Controller(**{**vars(a), "state": {**a.state, "forward_right_weights": state}})
    found = first_difference(a, other)
    assert found is not None
    assert (found.name, found.differing) == ("forward_right_weights[hip_height, x]", 1)
    wider = Body.from_dict({**BODY.to_dict(), "reach": [0.5] * 6})
    found = first_difference(a, Controller(**{**vars(a), "config": a.config.with_body(wider)}))
    assert found is not None
    assert found.name == "config.body.reach[0]"


def controller_of(learner: ForwardInverseLearner) -> Controller:
    return Controller.from_learner(learner, joints=ROBOT.joints, robot_toml="", robot_urdf="")


def test_a_controller_carries_its_body_and_nothing_else_is_needed() -> None:
    config = ForwardInverseConfig(degree=2).with_body(BODY)
    assert config_from_dict(config_to_dict(config)) == config
    assert "body" not in config_to_dict(ForwardInverseConfig())


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"hands": ["left"]}, "reach to be 3 finite numbers"),
        ({"hands": ["left", "left"]}, "hands to be different names"),
        ({"hands": ["left", "../right"]}, "hands to be from 1 to 32 names"),
        ({"joints": []}, "joints to be from 1 to 1000 names"),
        ({"lower": [3.0] * 15, "upper": [1.0] * 15}, "lower to be limits below"),
        ({"upper": ["1"] * 15}, "upper to be 15 finite numbers"),
        ({"upper": [float("inf")] * 15}, "upper to be 15 finite numbers"),
        ({"reach": [0.0] * 6}, "reach to be numbers above 0"),
        ({"moves": [[0, 1]]}, "moves to be places of joints"),
        ({"moves": [[0, 1], [15]]}, "moves to be places of joints"),
        ({"moves": [[1, 0], [0]]}, "moves to be places of joints"),
        ({"moves": [[True], [0]]}, "moves to be places of joints"),
        ({"moves": 3}, "expected lists"),
        ({"more": 1}, "expected a table with hands, joints"),
    ],
)
def test_a_body_that_is_none_is_one_line(changes: dict[str, object], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        ForwardInverseConfig.from_dict({"body": {**BODY.to_dict(), **changes}})


@pytest.mark.parametrize(
    "settings",
    [
        {"degree": 0},
        {"degree": 6},
        {"degree": 2.0},
        {"prior": 0.0},
        {"forgetting": 1.1},
        {"residual_degree": 6},
        {"residual_forgetting": 0.5},
        {"inverse_prior": 0.0},
        {"forgetting": 0.5},
        {"damping": float("nan")},
        {"inputs": 7},
        {"inputs": 6, "outputs": 6},
        {"body": 3},
    ],
)
def test_settings_out_of_their_range_are_refused(settings: dict[str, object]) -> None:
    with pytest.raises(ConfigError, match="expected"):
        ForwardInverseConfig.from_dict(settings)


def test_one_to_n_hands() -> None:
    for hands in (1, 2, 3):
        body = any_body(3 * hands, 3 * hands + 4)
        config = ForwardInverseConfig(degree=1).with_body(body)
        centre = np.zeros(config.outputs)
        learner = ForwardInverseLearner(config, input_centre=centre[: config.inputs], output_centre=centre)
        u = np.random.default_rng(hands).uniform(-0.2, 0.2, (40, config.inputs))
        learner.step(u, np.concatenate([u, np.resize(u, (40, 4))], axis=1), learning=True)
        assert learner.deviations(u).shape == (40, hands)
        assert list(learner.model_errors()) == ["inverse", *(f"forward_{name}" for name in body.hands)]


def test_a_state_with_variances_below_zero_is_refused_and_changes_nothing() -> None:
    learner = learner_of(degree=1)
    learner.step(*samples(postures(20, seed=10)), learning=True)
    state, digest = learner.state(), state_digest(learner.state())
    for name in ("forward_left_covariance", "inverse_errors"):
        with pytest.raises(ControllerError, match=f"at least 0 in state {name}"):
            learner.load_state({**state, name: -state[name]})
    assert state_digest(learner.state()) == digest


def test_parts_of_commands_are_what_explains_them(taught: ForwardInverseLearner) -> None:
    targets, _ = samples(postures(20, seed=11, spread=0.06))
    curves, explained = taught.curves(targets), taught.explain(targets)
    assert next(iter(curves)) == "Newton step [% of half the range]"
    assert (curves["Newton step [% of half the range]"] > 0.0).all()
    assert np.array_equal(curves["right hand: expected deviation [cm]"], 100.0 * explained.deviations[:, 1])
    assert [line.split(",")[0] for line in taught.lines()] == [
        "inverse: degree 3",
        "forward left: degree 3",
        "forward right: degree 3",
    ]


def test_what_a_controller_expects_is_evaluated_beside_what_it_errs(taught: ForwardInverseLearner) -> None:
    texts = {"robot_toml": ROBOT.toml_text, "robot_urdf": ROBOT.urdf_text}
    controllers = [Controller.from_learner(learner, joints=ROBOT.joints, **texts) for learner in (taught, learner_of())]
    trial, untaught = (evaluate_motion(controller, "eight") for controller in controllers)
    assert trial.deviations is not None
    distances = np.linalg.norm(trial.reached - trial.targets.reshape(-1, 2, 3), axis=2)
    summary = trial.summary()
    assert summary["within_deviation"] == (distances <= trial.deviations).mean()
    assert summary["deviation_cm"] == 100.0 * trial.deviations.mean()
    assert not {"deviation_cm", "within_deviation"} & untaught.summary().keys()


def test_a_served_controller_reports_the_deviation_of_its_last_command(
    taught: ForwardInverseLearner, tmp_path: Path
) -> None:
    texts = {"robot_toml": ROBOT.toml_text, "robot_urdf": ROBOT.urdf_text}
    log, found = write_plain_episode(tmp_path / "log.mcap"), []
    for learner in (taught, learner_of()):
        served = ServedController(Controller.from_learner(learner, joints=ROBOT.joints, **texts))
        assert "deviation_cm" not in served.status()
        for record in LogReader(log):
            if record.topic in served.topics:
                served.take(record)
        found.append(served.status())
    last = {
        record.topic: decode_as(PoseStamped, record.data).position for record in LogReader(log).records(topics=TARGETS)
    }
    target = np.concatenate([last[topic] for topic in TARGETS])
    (expected,) = taught.deviations(target[np.newaxis]) * 100.0
    assert found[0]["deviation_cm"] == dict(zip(("left", "right"), expected.tolist(), strict=True))
    assert "deviation_cm" not in found[1]  # nothing was learned
