"""Targets in the robot's own time: from where the hands are, no faster than a hand should go, and through motions."""

import numpy as np
import pytest
from more_hands import ONE, write_robot

from pipeline.browser.session.drive import TICK_NS, Drive, Mode
from pipeline.browser.session.motion_loop import MotionLoop
from pipeline.browser.session.moving_targets import MovingTargets, PaceConfig
from pipeline.motions.motion import Motion, load_motion
from pipeline.robot.config import load_robot
from pipeline.robot.coordinates import centre_rows
from pipeline.robot.kinematics import Kinematics
from pipeline.rotations import quaternions_of
from recorders.errors import ConfigError

START_NS = 5_000_000_000


@pytest.fixture(scope="module")
def robot():
    return load_robot("asimo")


def run(drive, q, *, ticks, start_ns=START_NS):
    return [drive.take(start_ns + number * TICK_NS, q) for number in range(ticks)]


def test_nothing_is_asked_before_somebody_leads(robot):
    drive = Drive(robot)
    assert run(drive, robot.comfort, ticks=3) == [None] * 3
    assert drive.snapshot().mode is Mode.AT_REST
    assert drive.last_stamp_ns is None


def test_a_hand_goes_where_it_is_wanted_and_the_other_stays(robot):
    drive = Drive(robot)
    run(drive, robot.comfort, ticks=1)
    hands = drive.snapshot().hands
    wanted = hands[1] + [0.0, -0.1, 0.0]
    drive.move_hand(1, wanted)
    ticks = run(drive, robot.comfort, ticks=100, start_ns=START_NS + TICK_NS)
    rows = np.array([tick.rows for tick in ticks])
    assert [tick.begins for tick in ticks] == [True] + [False] * 99
    assert np.array_equal(rows[0], hands)
    assert np.array_equal(rows[-1][1], wanted)
    assert np.array_equal(rows[:, 0], np.broadcast_to(hands[0], (100, 3)))
    speeds = np.linalg.norm(np.diff(rows[:, 1], axis=0), axis=1) / (TICK_NS * 1e-9)
    assert speeds.max() <= PaceConfig().speed_m_s * (1 + 1e-9)


@pytest.mark.parametrize("number", [np.nan, np.inf])
def test_a_row_that_is_not_finite_moves_no_hand(robot, number):
    drive = Drive(robot)
    run(drive, robot.comfort, ticks=1)
    drive.move_hand(1, np.full(3, number))
    assert drive.snapshot().mode is Mode.AT_REST
    assert np.isfinite(drive.snapshot().wanted).all()


def test_states_faster_than_ticks_make_none_of_their_own(robot):
    drive = Drive(robot)
    drive.hold()
    made = [drive.take(START_NS + number * TICK_NS // 4, robot.comfort) for number in range(9)]
    assert [tick is not None for tick in made] == [True, False, False, False] * 2 + [True]


def test_a_clock_that_begins_anew_is_followed_from_where_the_hands_are(robot):
    drive = Drive(robot)
    drive.hold()
    drive.move_hand(0, drive.snapshot().hands[0] + [0.0, 0.0, 0.1])
    run(drive, robot.comfort, ticks=50)
    wanted = drive.snapshot().wanted
    tick = drive.take(0, robot.comfort)
    assert tick.begins
    assert np.array_equal(tick.rows, drive.snapshot().hands)
    assert np.array_equal(run(drive, robot.comfort, ticks=100, start_ns=TICK_NS)[-1].rows, wanted)


def test_an_error_is_of_a_target_at_the_end_of_its_hold(robot):
    drive = Drive(robot)
    drive.hold()
    drive.answer()
    run(drive, robot.comfort, ticks=2)
    q = robot.comfort + 0.01
    drive.take(START_NS + 2 * TICK_NS, q)
    kinematics = Kinematics(robot)
    moved_cm = 100 * np.linalg.norm(kinematics.hands(q) - kinematics.hands(robot.comfort), axis=1)
    assert drive.snapshot().error.distances_cm == pytest.approx(moved_cm, rel=1e-12)
    assert drive.snapshot().mean.ticks == 1


def test_no_error_is_counted_until_a_controller_answers_and_then_nothing_leaps(robot):
    drive = Drive(robot)
    drive.hold()
    run(drive, robot.comfort, ticks=1)
    drive.move_hand(1, drive.snapshot().hands[1] + [0.0, 0.0, 0.1])
    run(drive, robot.comfort, ticks=100, start_ns=START_NS + TICK_NS)
    now = drive.snapshot()
    assert np.abs(now.targets - now.hands).max() > 0.05
    assert (now.is_answered, now.error, now.mean.ticks, drive.errors()) == (False, None, 0, [])
    drive.answer()
    tick = drive.take(START_NS + 101 * TICK_NS, robot.comfort)
    assert tick.begins
    assert np.array_equal(tick.rows, now.hands)
    drive.take(START_NS + 102 * TICK_NS, robot.comfort)
    assert drive.snapshot().is_answered
    assert drive.snapshot().error.distances_cm.max() < 0.1
    assert drive.snapshot().mean.ticks == 1


def test_a_controller_that_answers_no_more_has_no_errors(robot):
    drive = Drive(robot)
    drive.hold()
    drive.answer()
    run(drive, robot.comfort, ticks=200)
    now = drive.snapshot()
    assert (now.is_answered, now.error) == (False, None)
    assert 0 < now.mean.ticks < 100


def test_a_motion_is_gone_through_in_its_own_time(robot):
    motion = load_motion("circles", robot)
    drive = Drive(robot)
    loop = drive.go_through(motion)
    q = robot.comfort
    run(drive, q, ticks=200)
    rows = drive.snapshot().targets
    assert loop.at_s > 0.0
    drive.take(START_NS + 200 * TICK_NS, q)
    assert loop.rows == pytest.approx(drive.snapshot().targets, abs=1e-12)
    assert not np.array_equal(rows, drive.snapshot().targets)
    drive.seek(10.0)
    loop.paused = True
    assert run(drive, q, ticks=200, start_ns=START_NS + 300 * TICK_NS)[-1].rows == pytest.approx(
        motion.targets[50], abs=1e-9
    )


def test_a_first_motion_is_gone_through_only_where_nothing_is_asked_of_the_robot(robot):
    motion = load_motion("circles", robot)
    for ask, mode in ((Drive.hold, Mode.HANDLES), (lambda drive: drive.lend(lent=True), Mode.LENT)):
        drive = Drive(robot)
        ask(drive)
        drive.begin(motion)
        assert (drive.snapshot().mode, drive.snapshot().loop) == (mode, None)
    drive = Drive(robot)
    drive.begin(motion)
    assert (drive.snapshot().mode, drive.snapshot().loop.name) == (Mode.MOTION, "circles")


def test_a_closed_motion_goes_round_and_an_open_one_begins_again():
    times_s, targets = np.arange(3.0), np.arange(9.0).reshape(3, 1, 3) / 10.0
    closed, opened = (MotionLoop(Motion("m", times_s, targets, closed=is_closed)) for is_closed in (True, False))
    assert (closed.duration_s, opened.duration_s) == (3.0, 2.0)
    closed.seek(2.5)
    assert closed.rows == pytest.approx((targets[2] + targets[0]) / 2)
    assert not closed.advance(1.0)
    assert closed.at_s == pytest.approx(0.5)
    opened.seek(1.5)
    assert opened.advance(1.0)
    assert opened.at_s == 0.0
    opened.seek(99.0)
    assert opened.at_s == 2.0


def test_where_the_pose_counts_hands_turn_no_faster_than_they_should(tmp_path):
    robot = load_robot(write_robot(tmp_path / "robot", ONE, poses=ONE))
    rows = centre_rows(robot)
    moving = MovingTargets(robot, rows)
    moving.wanted[0, 3:] = quaternions_of(np.array([0.0, 0.0, 1.0]))
    config = PaceConfig()
    turned = [moving.advance(0.02)[0, 3:] for _ in range(300)]
    cosines = np.abs(np.sum(np.array(turned)[1:] * np.array(turned)[:-1], axis=1)).clip(max=1.0)
    assert (2 * np.arccos(cosines)).max() <= 0.02 * config.turn_rad_s * (1 + 1e-6)
    assert np.abs(turned[-1]) == pytest.approx(np.abs(moving.wanted[0, 3:]), abs=1e-6)


def test_a_pace_is_above_zero():
    with pytest.raises(ConfigError, match="above 0"):
        PaceConfig(speed_m_s=0.0)
