"""An exploration of the hands' boxes: drawn by seed, within reach, clear of the body, with noise of a stated size."""

from itertools import islice
from pathlib import Path

import numpy as np
import pytest

from pipeline.collision.self_distance import CLEARANCE_M, SelfDistance
from pipeline.exploration.episode import Guidance
from pipeline.exploration.explore import ExplorationResult, explore
from pipeline.exploration.joint_noise import joint_noise
from pipeline.exploration.reproduce import simulate
from pipeline.exploration.source import Source, source
from pipeline.exploration.sources import volume as volume_source
from pipeline.motions.motion import Motion
from pipeline.robot.config import load_robot
from pipeline.robot.kinematics import Kinematics
from pipeline.teacher.teacher import Teacher, approach
from recorders.cdr.codec import decode, encode
from recorders.errors import ConfigError
from recorders.messages.topics import JOINT_STATES, SAMPLE_JOINTS
from recorders.reading.reader import LogReader
from recorders.ticks.joiner import JointMap

ASIMO = load_robot("asimo")
SECONDS = 6.0


def volume(**settings: float) -> Source:
    return source("volume", **{"duration_s": SECONDS, **settings})


def motion(seed: int, **settings: float) -> Motion:
    return volume(**settings).motion(ASIMO, seed=seed)


@pytest.fixture(scope="module")
def explored(tmp_path_factory: pytest.TempPathFactory) -> ExplorationResult:
    drawn = volume()
    return explore(
        ASIMO,
        drawn.motion(ASIMO, seed=0),
        seed=0,
        out=tmp_path_factory.mktemp("volume") / "volume.mcap",
        teacher=drawn.teacher,
        config=drawn.config,
        guidance=Guidance(must_reach=False, keep_clear=True),
    )


def test_a_seed_names_the_motion_and_another_names_another() -> None:
    assert motion(seed=0).sha256 == motion(seed=0).sha256
    assert motion(seed=0).sha256 != motion(seed=1).sha256


@pytest.mark.parametrize("rate_hz", [5, 50])
def test_targets_come_at_the_rate_and_stay_in_the_boxes(rate_hz: int) -> None:
    drawn = motion(seed=0, tick_rate_hz=rate_hz)

    boxes = np.array([hand.box for hand in ASIMO.hands])
    assert len(drawn) == SECONDS * rate_hz
    assert np.allclose(np.diff(drawn.times_s), 1.0 / rate_hz)
    assert (np.abs(drawn.targets - ASIMO.centres) <= boxes + 1e-9).all()
    assert (np.ptp(drawn.targets, axis=0) > 0.3 * boxes).all(), "the motion explores hardly any of the boxes"


def test_both_rates_go_through_the_same_points() -> None:
    slow, fast = motion(seed=0), motion(seed=0, tick_rate_hz=50)

    assert np.array_equal(slow.targets, fast.targets[::10])


def test_the_robot_stays_clear_of_itself_and_says_how_clear(explored: ExplorationResult) -> None:
    measured = [decode(record.type, record.data) for record in LogReader(explored.path).records(topics=[JOINT_STATES])]
    distances = SelfDistance(ASIMO)
    smallest = min(distances.nearest(JointMap(ASIMO.joints).positions(joints)).distance_m for joints in measured)

    assert explored.self_distance_cm is not None
    assert 100.0 * CLEARANCE_M <= explored.self_distance_cm <= 100.0 * smallest + 1e-4


def test_held_targets_are_planned_for(monkeypatch: pytest.MonkeyPatch) -> None:
    at_first_m = commanded_distance_m(motion(seed=8, duration_s=3.0), seed=8)
    monkeypatch.setattr(volume_source, "_HELD_LAG_SHARE", 0.08)
    careful_m = commanded_distance_m(motion(seed=8, duration_s=3.0), seed=8)

    wanted_m = CLEARANCE_M + 0.08 * 0.25  # of boxes of 25 cm
    assert at_first_m < wanted_m - 0.01
    assert careful_m > wanted_m - 0.002  # the plan goes in steps of 20 ms


def commanded_distance_m(drawn: Motion, *, seed: int) -> float:
    """Smallest distance of asimo's parts in what is commanded, with each target held until the next [m]."""
    way, distances = volume(), SelfDistance(ASIMO)
    teacher = Teacher(Kinematics(ASIMO), way.teacher)
    noise = way.config.noise(ASIMO, seed=seed, period_ns=teacher.period_ns)
    assert noise is not None
    posture, _ = approach(teacher, ASIMO.comfort, drawn.targets[0])
    commanded = []
    for target in np.repeat(drawn.targets, 200_000_000 // teacher.period_ns, axis=0):
        posture = teacher.step(posture, target)
        commanded.append(posture + next(noise))
    return min(distances.nearest(one).distance_m for one in commanded[::4])


def test_a_robot_whose_hands_begin_near_its_body_finds_a_way() -> None:
    drawn = volume(duration_s=1.0).motion(load_robot("icub"), seed=3)

    assert len(drawn) == 5


@pytest.mark.campaign
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("name", ["icub", "g1", "talos"])
def test_every_robot_explores_its_boxes(name: str, seed: int, tmp_path: Path) -> None:
    robot, way = load_robot(name), source("volume")

    done = explore(
        robot,
        way.motion(robot, seed=seed),
        seed=seed,
        out=tmp_path / "volume.mcap",
        config=way.config,
        guidance=way.guidance(robot, seed=seed),
    )

    assert done.self_distance_cm is not None
    assert done.self_distance_cm >= 100.0 * CLEARANCE_M


def test_limits_reached_are_in_the_manifest(explored: ExplorationResult) -> None:
    limits = LogReader(explored.path).manifest["limits"]

    assert limits["self_distance_cm"] == explored.self_distance_cm
    assert limits["limit_margin"] == explored.limit_margin > 0.0
    assert 0.0 < explored.joint_speed == limits["joint_speed"]
    assert {explored.limit_joint, explored.speed_joint} <= set(ASIMO.joints)


def test_noise_has_the_deviation_that_is_asked_for() -> None:
    steps = np.array(list(islice(joint_noise(ASIMO, seed=0, period_ns=20_000_000, share=0.01), 20_000)))
    span = ASIMO.upper - ASIMO.lower

    assert (np.abs(steps.std(axis=0) / span - 0.01) < 0.004).all()
    assert (np.abs(np.diff(steps, axis=0)).max(axis=0) < 0.005 * span).all(), "it jumps"


def test_noise_begins_at_rest_and_is_named_by_its_seed() -> None:
    def first(seed: int) -> np.ndarray:
        return next(joint_noise(ASIMO, seed=seed, period_ns=5_000_000, share=0.01))

    assert np.array_equal(first(0), first(0))
    assert not np.array_equal(first(0), first(1))
    assert (np.abs(first(0)) < 0.002 * (ASIMO.upper - ASIMO.lower)).all()


@pytest.mark.parametrize(
    ("name", "settings", "words"),
    [
        ("circles", {"duration_s": 3.0}, "has its own duration"),
        ("circles", {"tick_rate_hz": 50}, "has its own duration"),
        ("volume", {"tick_rate_hz": 7}, "found 7 Hz"),
        ("volume", {"tick_rate_hz": 100}, "found 100 Hz"),
        ("volume", {"duration_s": 0.5}, r"found 0\.5 s"),
        ("volume", {"duration_s": float("nan")}, "found nan s"),
        ("volume", {"comfort_gain": -1.0}, "comfort_gain: expected at least 0"),
    ],
)
def test_what_cannot_be_is_refused_in_a_line(name: str, settings: dict[str, float], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        source(name, **settings)


def test_the_comfort_gain_is_of_any_motion() -> None:
    assert source("circles").teacher.comfort_gain == 5.0
    assert source("circles", comfort_gain=20.0).teacher.comfort_gain == 20.0
    assert volume().teacher.comfort_gain == 20.0


def test_the_same_exploration_is_simulated_again_from_its_log(explored: ExplorationResult) -> None:
    logged = [record.data for record in LogReader(explored.path).records(topics=[SAMPLE_JOINTS])]

    again = [encode(message) for topic, message in simulate(explored.path, ticks=6) if topic == SAMPLE_JOINTS]

    assert again == logged[:6]
