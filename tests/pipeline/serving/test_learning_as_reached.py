"""A served controller learns from what was reached, knows how far off it may be, and refuses what it has not seen."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest
from small_inverse import ROBOT, asked, hands_at, measured, postures, taught

from pipeline.learner.controller import Controller
from pipeline.learner.rules.reservoir.config import LearnerConfig
from pipeline.learner.rules.reservoir.learner import Learner
from pipeline.learner.state import state_digest
from pipeline.robot.hand_kinematics import HandKinematics
from pipeline.serving.clock_reset import RESTART_AFTER
from pipeline.serving.config import ServingConfig
from pipeline.serving.deviations import BEYOND
from pipeline.serving.input.served_inputs import ServedInputs
from pipeline.serving.node_config import ServeConfig
from pipeline.serving.served_controller import ServedController
from pipeline.serving.tick_stream import MAX_OPEN
from pipeline.simulation.joint_offset import joint_offsets
from recorders.cdr.codec import decode_as
from recorders.errors import ConfigError
from recorders.messages.message_types import JointState
from recorders.messages.record import RecordedMessage
from recorders.messages.topics import SAMPLE_JOINTS
from recorders.ticks.live import WAIT_TICKS

LEARN = ServingConfig(learn=True)
MIDDLE = ROBOT.input_centre.reshape(2, 3)


@pytest.fixture(scope="module")
def controller() -> Controller:
    return taught()


def feed(served: ServedController, records: Iterable[RecordedMessage]) -> list[np.ndarray]:
    """Return the postures commanded."""
    commands = [command for record in records if (command := served.take(record)) is not None]
    return [decode_as(JointState, command.data).position for command in commands]


def test_what_was_reached_is_learned_as_in_a_training_whatever_is_asked_for_meanwhile(controller: Controller) -> None:
    joints = postures(12, seed=1)
    hands = hands_at(joints) + 0.002
    learned: list[tuple[RecordedMessage, ...]] = []
    served = ServedController(controller, config=LEARN, on_learned=learned.append)
    for k in range(12):
        assert len(feed(served, asked(2 * k, MIDDLE + 0.01 * k))) == 1
        feed(served, measured(2 * k + 1, joints[k], hands[k]))
    learner, flat = controller.adaptive().learner(), hands.reshape(12, 6)
    learner.step(flat, np.concatenate([flat, joints], axis=1), learning=True)
    assert served.status()["learned_steps"] == len(learned) == 12
    assert served.status()["digest"] == state_digest(learner.state(), np.empty(0)) == served.controller().digest
    assert served.controller().digest != controller.digest


def test_topics_of_other_names_are_each_taken_once(controller: Controller) -> None:
    """Targets and what is learned, all renamed: every message is one, and none is refused."""
    joints = postures(3, seed=9)
    hands = hands_at(joints)
    served = ServedController(controller, config=LEARN)
    renames = {f"/lab{topic}": topic for topic in served.topics}
    inputs = ServedInputs(controller, ServeConfig(serving=LEARN, renames=renames), served.topics)
    assert set(inputs.topics) == set(renames)
    sent = [m for k in range(3) for m in (*asked(2 * k, MIDDLE), *measured(2 * k + 1, joints[k], hands[k]))]
    taken = [made for record in sent for made in inputs.taken(record._replace(topic=f"/lab{record.topic}"))]
    assert taken == sent
    assert len(feed(served, taken)) == 3
    assert (served.status()["learned_steps"], served.status()["refused"]) == (3, {})


def test_learning_makes_the_next_command_better_where_the_robot_is_other_than_taught(controller: Controller) -> None:
    offset = np.full(len(ROBOT.joints), 0.02)  # the joints are not where they are measured

    def distance(served: ServedController, stamp: int) -> tuple[float, np.ndarray]:
        (command,) = feed(served, asked(stamp, MIDDLE))
        return float(np.linalg.norm(hands_at(command[np.newaxis] - offset)[0] - MIDDLE, axis=1).mean()), command

    served = ServedController(controller, config=LEARN)
    before, _ = distance(served, 0)
    for k in range(1, 60):
        _, command = distance(served, 2 * k)
        feed(served, measured(2 * k + 1, command, hands_at(command[np.newaxis] - offset)[0]))
    after, _ = distance(served, 1000)
    assert after < before / 3.0


def test_joints_that_are_off_are_learned_in_a_pass_and_taken_up_again_to_the_bit(
    controller: Controller, tmp_path: Path
) -> None:
    """Stopped, saved and served again, it has the state of one that went on, and of one trained on what was reached."""
    offsets = joint_offsets(0, len(ROBOT.joints), largest=0.05)
    joints = postures(60, seed=5, spread=0.05)
    hands = hands_at(joints - offsets)
    ticks = [measured(k, joints[k], hands[k]) for k in range(60)]
    whole, first = (ServedController(controller, config=LEARN) for _ in range(2))
    for tick in ticks[:25]:
        feed(first, tick)
    first.controller().save(tmp_path / "stopped.npz")
    second = ServedController(Controller.load(tmp_path / "stopped.npz"), config=LEARN)
    for tick in ticks[25:]:
        feed(second, tick)
    for tick in ticks:
        feed(whole, tick)
    learner, flat = controller.adaptive().learner(), hands.reshape(60, 6)
    learner.step(flat, np.concatenate([flat, joints], axis=1), learning=True)
    digests = {served.status()["digest"] for served in (whole, second)}
    assert digests == {state_digest(learner.state(), np.empty(0))}
    assert {name.partition("_")[0] for name in whole.controller().state} == {"inverse", "forward", "residual"}
    still, learned = (distances(one, offsets) for one in (controller, second.controller()))
    assert learned.mean() < 0.1 * still.mean()


def distances(controller: Controller, offsets: np.ndarray) -> np.ndarray:
    """How far the hands of a robot whose joints are off are from targets about the middle, shape (n, 2) [m]."""
    targets = hands_at(postures(40, seed=6, spread=0.03))
    joints = controller.learner().predict(targets.reshape(-1, 6))[:, 6:]
    return np.linalg.norm(hands_at(joints - offsets) - targets, axis=2)


def test_a_controller_that_only_serves_stays_as_it_was_taught(controller: Controller) -> None:
    served = ServedController(controller)
    feed(served, asked(0, MIDDLE))
    assert served.controller().digest == controller.digest
    assert controller.adaptive().adaptive().digest == controller.adaptive().digest != controller.digest


def test_hands_without_joints_are_passed_over_and_joints_without_hands_are_not(controller: Controller) -> None:
    served = ServedController(controller, config=LEARN)
    joints = postures(4, seed=2)
    hands = hands_at(joints)
    for k in range(3):
        feed(served, measured(2 * k, joints[k], hands[k]))
        feed(served, measured(2 * k + 1, joints[k], hands[k])[:2])
    assert served.status()["learned_steps"] == 3
    assert served.status()["refused"] == {}
    feed(served, measured(10, joints[3], hands[3])[2:])
    feed(served, measured(11, joints[3], hands[3]))
    assert served.status()["refused"] == {"no partner": 1}


def test_a_clock_of_the_joints_that_begins_anew_is_followed(controller: Controller) -> None:
    served = ServedController(controller, config=LEARN)
    joints = postures(RESTART_AFTER + 3, seed=3)
    hands = hands_at(joints)
    feed(served, measured(10**9, joints[0], hands[0]))
    for k in range(RESTART_AFTER + 2):
        feed(served, measured(k, joints[k + 1], hands[k + 1]))
    assert served.status()["refused"] == {"stale": 3 * RESTART_AFTER}
    assert served.status()["learned_steps"] == 3


def test_when_nothing_that_was_reached_comes_that_is_one_line(controller: Controller) -> None:
    lines: list[str] = []
    served = ServedController(controller, config=LEARN, report=lines.append)
    for stamp in range(2 * MAX_OPEN):
        feed(served, asked(stamp, MIDDLE))
        served.settle()
    (line,) = lines
    assert SAMPLE_JOINTS in line
    assert "/hand/left/measured" in line


def test_where_no_hands_are_measured_those_of_the_robots_kinematics_are_learned(controller: Controller) -> None:
    joints, lines = postures(WAIT_TICKS + 5, seed=7), list[str]()
    learned: list[tuple[RecordedMessage, ...]] = []
    served = ServedController(controller, config=LEARN, on_learned=learned.append, report=lines.append)
    for k, posture in enumerate(joints):
        feed(served, measured(k, posture, hands_at(posture[np.newaxis])[0])[2:])
        assert len(learned) == (k + 1 if k + 1 >= WAIT_TICKS else 0)
    learner, hands = controller.adaptive().learner(), HandKinematics(ROBOT).positions(joints).reshape(len(joints), 6)
    learner.step(hands, np.concatenate([hands, joints], axis=1), learning=True)
    status, written = served.status(), served.controller()
    assert (status["pairs"], status["learned_steps"], status["refused"]) == ("computed", len(joints), {})
    assert status["digest"] == written.digest == state_digest(learner.state(), np.empty(0))
    assert (written.pairs, written.provenance["learned_from"]) == ("reached", "computed")
    assert [records[0].topic for records in learned] == [SAMPLE_JOINTS] * len(joints)
    (line,) = lines
    assert "pairs computed, as /hand/left/measured" in line


def test_hands_that_come_late_are_learned_from_all_the_same(controller: Controller) -> None:
    joints = postures(WAIT_TICKS + 3, seed=8)
    hands = hands_at(joints)
    served = ServedController(controller, config=LEARN)
    for k in range(WAIT_TICKS - 1):
        feed(served, measured(k, joints[k], hands[k])[2:])
    for k in range(WAIT_TICKS - 1, WAIT_TICKS + 3):
        feed(served, measured(k, joints[k], hands[k]))
    assert (served.status()["pairs"], served.status()["learned_steps"]) == ("reached", 4)


@pytest.mark.parametrize("forgetting", [1.0, 0.999])
def test_a_held_target_winds_nothing_up(forgetting: float) -> None:
    """Variances only fall where nothing is forgotten; else they stay below the prior, and the state comes to rest."""
    held = taught(forgetting=forgetting)
    prior = held.config.to_dict()["prior"]
    served = ServedController(held, config=LEARN)
    joints = postures(1, seed=4)[0]
    hands = hands_at(joints[np.newaxis])[0]
    digests, before = set(), held.state
    for stamp in range(3500):
        feed(served, measured(stamp, joints, hands))
        if stamp % 100 == 99 and stamp >= 3100:
            digests.add(served.status()["digest"])
    state = served.controller().state
    most = 1.0 / float(held.adaptive().config.to_dict()["residual_prior"])
    assert (diagonal(state["residual_covariance"]) <= most * (1.0 + 1e-9)).all()
    for name in ("inverse_covariance", "forward_left_covariance", "forward_right_covariance"):
        variances, earlier = diagonal(state[name]), diagonal(before[name])
        assert (variances <= (earlier if forgetting == 1.0 else 1.0 / float(prior)) * (1.0 + 1e-9)).all()
    if forgetting < 1.0:
        assert len(digests) == 1
    (command,) = feed(served, asked(0, hands))
    assert np.linalg.norm(hands_at(command[np.newaxis])[0] - hands, axis=1).max() < 1e-3


def diagonal(triangle: np.ndarray) -> np.ndarray:
    size = round((2.0 * len(triangle)) ** 0.5 - 0.5)
    return triangle[np.concatenate([[0], np.cumsum(np.arange(size, 1, -1))])]


def test_deviations_are_those_of_the_learner_in_the_order_of_the_commands(controller: Controller) -> None:
    found: list[tuple[int, np.ndarray]] = []
    served = ServedController(controller, on_deviation=lambda stamp, values: found.append((stamp, values)))
    for k in range(5):
        feed(served, asked(k, MIDDLE + 0.01 * k))
    served.settle()
    expected = controller.learner().deviations([(MIDDLE + 0.01 * k).ravel() for k in range(5)])  # type: ignore[attr-defined]
    assert [stamp for stamp, _ in found] == list(range(5))
    assert np.array_equal([values for _, values in found], expected)
    shown = served.status()
    assert list(shown["deviation_cm"].values()) == (expected[-1] * 100.0).tolist()
    assert list(shown["deviation_max_cm"].values()) == (expected.max(axis=0) * 100.0).tolist()
    assert served.state == f"serving, deviation {expected[-1].max() * 100.0:.2g} cm"


def test_a_rule_without_deviations_has_the_status_that_it_had() -> None:
    assert not {"deviation_cm", "beyond"} & ServedController(reservoir("commanded")).status().keys()


FAR = MIDDLE + np.array([0.15, 0.3, 0.3])


def test_targets_beyond_what_was_explored_are_counted_served_and_reported_once(controller: Controller) -> None:
    lines: list[str] = []
    served = ServedController(controller, report=lines.append)
    learner = controller.learner()
    bounds = BEYOND * learner.usual_deviations()  # type: ignore[attr-defined]
    near, far = learner.deviations([MIDDLE.ravel(), FAR.ravel()])  # type: ignore[attr-defined]
    assert (near <= bounds).all()
    assert (far > bounds).any()
    assert len(feed(served, [m for k in range(4) for m in asked(k, FAR if k % 2 else MIDDLE)])) == 4
    assert served.status()["beyond"] == served.counts()["beyond"] == 2
    assert ["beyond what was explored" in line for line in lines] == [True]


def test_targets_beyond_what_was_explored_are_refused_if_asked_for(controller: Controller) -> None:
    served = ServedController(controller, config=ServingConfig(refuse_beyond=True))
    usual = ServedController(controller)
    sent = feed(served, [m for k in range(4) for m in asked(k, FAR if k % 2 else MIDDLE)])
    assert np.array_equal(sent, feed(usual, [m for k in (0, 2) for m in asked(k, MIDDLE)]))
    assert served.status()["refused"] == {"beyond": 2}
    assert served.status()["beyond"] == 2
    assert served.answer_pair(*(message.data for message in asked(9, FAR))) is None


def test_before_anything_was_learned_all_is_beyond() -> None:
    served = ServedController(taught(samples=0), config=ServingConfig(refuse_beyond=True))
    assert feed(served, asked(0, MIDDLE)) == []
    assert served.status()["refused"] == {"beyond": 1}


def reservoir(pairs: str) -> Controller:
    centre = np.concatenate([ROBOT.input_centre, ROBOT.comfort])
    learner = Learner(LearnerConfig(seed=4, epochs=1), input_centre=ROBOT.input_centre, output_centre=centre)
    texts = {"robot_toml": ROBOT.toml_text, "robot_urdf": ROBOT.urdf_text}
    return Controller.from_learner(learner, joints=ROBOT.joints, pairs=pairs, **texts)


def test_what_a_controller_cannot_do_is_refused_by_name() -> None:
    with pytest.raises(ConfigError, match=r"--learn: .* pairs commanded.* found one of reached and rule reservoir"):
        ServedController(reservoir("reached"), config=LEARN)
    with pytest.raises(ConfigError, match=r"--refuse-beyond: .* found one of rule reservoir"):
        ServedController(reservoir("commanded"), config=ServingConfig(refuse_beyond=True))
