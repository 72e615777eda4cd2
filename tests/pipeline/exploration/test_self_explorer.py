"""A learner that explores by itself has, at the end, the state that its recording teaches; it knows what it knows."""

import math

import numpy as np
import pytest

from pipeline.collision.self_distance import SelfDistance
from pipeline.exploration.explore import ExplorationResult, explore
from pipeline.exploration.reproduce import simulate
from pipeline.exploration.self_explorer import SelfExplorer
from pipeline.exploration.source import Source, self_exploration
from pipeline.learner.registry import default_config
from pipeline.motions.motion import Motion
from pipeline.robot.config import load_robot
from pipeline.robot.kinematics import Kinematics
from pipeline.training.trainer import train
from recorders.cdr.codec import encode
from recorders.errors import ConfigError
from recorders.messages.topics import SAMPLE_JOINTS
from recorders.reading.reader import LogReader

ASIMO = load_robot("asimo")
SECONDS = 10.0


@pytest.fixture(scope="module")
def explored(tmp_path_factory: pytest.TempPathFactory) -> tuple[ExplorationResult, SelfExplorer]:
    return run(self_exploration(duration_s=SECONDS), tmp_path_factory.mktemp("self") / "self.mcap")


def run(source: Source, out: object, *, seed: int = 0) -> tuple[ExplorationResult, SelfExplorer]:
    guidance = source.guidance(ASIMO, seed=seed)
    assert isinstance(guidance.guide, SelfExplorer)
    result = explore(
        ASIMO,
        source.motion(ASIMO, seed=seed),
        seed=seed,
        out=str(out),
        guidance=guidance,
        config=source.config,
    )
    return result, guidance.guide


def test_its_recording_teaches_the_state_that_it_had(explored: tuple[ExplorationResult, SelfExplorer]) -> None:
    result, guide = explored

    config = default_config("forward-inverse")
    trained = train([result.path], schedule=config.schedule(), config=config)

    assert trained.result()["digest"] == guide.digest
    assert guide.ticks == result.ticks


def test_it_learns_to_reach_in_seconds(explored: tuple[ExplorationResult, SelfExplorer]) -> None:
    guide, kinematics = explored[1], Kinematics(ASIMO)
    targets = ASIMO.centres + 0.05 * np.random.default_rng(0).uniform(-1.0, 1.0, (20, 2, 3))

    joints = guide.learner.predict(targets.reshape(20, 6))[:, 6:]

    errors_m = np.linalg.norm(kinematics.hands_along(joints) - targets, axis=2)
    untaught_m = np.linalg.norm(kinematics.hands(ASIMO.comfort) - targets, axis=2)
    assert errors_m.mean() < 0.1 * untaught_m.mean()


def test_it_expects_less_error_the_more_it_has_seen(explored: tuple[ExplorationResult, SelfExplorer]) -> None:
    assert math.isinf(SelfExplorer(ASIMO, seed=0).predicted_cm)
    assert 0.0 < explored[1].predicted_cm < math.inf


def test_it_ends_once_it_expects_little_enough(
    explored: tuple[ExplorationResult, SelfExplorer], tmp_path_factory: pytest.TempPathFactory
) -> None:
    bound_cm = 1.5 * explored[1].predicted_cm
    source = self_exploration(duration_s=SECONDS, until_cm=bound_cm)

    result, guide = run(source, tmp_path_factory.mktemp("until") / "until.mcap")

    assert guide.predicted_cm < bound_cm
    assert result.ticks == guide.ticks < explored[0].ticks
    logged = [record.data for record in LogReader(result.path).records(topics=[SAMPLE_JOINTS])]
    whole = [record.data for record in LogReader(explored[0].path).records(topics=[SAMPLE_JOINTS])]
    assert logged == whole[: len(logged)], "until when it explores changes what it does"


def test_it_stays_off_its_own_body(explored: tuple[ExplorationResult, SelfExplorer]) -> None:
    guide, distances = explored[1], SelfDistance(ASIMO)
    posture = guide.step(ASIMO.comfort, ASIMO.centres)
    behind = ASIMO.centres - np.array([0.3, 0.0, 0.0])  # inside the torso

    for _ in range(200):
        posture = guide.step(posture, behind)

    assert distances.nearest(posture).distance_m > 0.03


def test_the_same_exploration_is_simulated_again_from_its_log(
    explored: tuple[ExplorationResult, SelfExplorer],
) -> None:
    logged = [record.data for record in LogReader(explored[0].path).records(topics=[SAMPLE_JOINTS])]

    again = [encode(message) for topic, message in simulate(explored[0].path, ticks=60) if topic == SAMPLE_JOINTS]

    assert again == logged[:60]


def test_its_targets_keep_the_hands_apart() -> None:
    motion: Motion = self_exploration(duration_s=60.0).motion(ASIMO, seed=0)

    apart_m = np.linalg.norm(motion.targets[:, 0] - motion.targets[:, 1], axis=1)
    assert apart_m.min() >= 0.1 - 1e-6
    assert (np.ptp(motion.targets, axis=0) > [0.1, 0.4, 0.4]).all()


def test_an_error_of_zero_is_never_expected() -> None:
    with pytest.raises(ConfigError, match="expected above 0 cm"):
        self_exploration(until_cm=0.0)
