"""Figures of a controller over a round of a motion: complete once all of it was driven, and of nothing else."""

import numpy as np
import pytest

from pipeline.browser.session.drive import TICK_NS, Drive, Mode
from pipeline.browser.session.figures import RoundFigures, TickError
from pipeline.browser.session.motion_loop import MotionLoop
from pipeline.motions.motion import Motion, load_motion
from pipeline.robot.config import load_robot

TICK_S = TICK_NS * 1e-9
START_NS = 5_000_000_000


def loop_of(name="round", *, seconds=4, closed=True):
    times_s = np.arange(float(seconds))
    return MotionLoop(Motion(name, times_s, np.linspace(0.0, 0.3, 6 * seconds).reshape(seconds, 2, 3), closed=closed))


def drive_on(figures, loop, errors_cm):
    for left_cm in errors_cm:
        figures.add(loop, TickError(0, np.array([left_cm, 1.0]), {}), TICK_S)


def test_a_round_is_whole_once_all_of_the_motion_was_driven():
    figures, loop = RoundFigures(), loop_of()
    drive_on(figures, loop, [0.5] * 100)
    assert figures.of(loop)[""].share == pytest.approx(0.5)
    drive_on(figures, loop, [1.5] * 100)
    found = figures.of(loop)[""]
    assert found.share == 1.0
    assert found.mean.hands_cm == pytest.approx([1.0, 1.0], abs=0.01)
    assert found.largest_cm.tolist() == [1.5, 1.0]


def test_the_last_whole_round_stays_until_the_next_is_whole():
    figures, loop = RoundFigures(), loop_of()
    drive_on(figures, loop, [0.5] * 200)
    drive_on(figures, loop, [9.0] * 100)
    assert figures.of(loop)[""].largest_cm[0] == 0.5
    drive_on(figures, loop, [9.0] * 100)
    assert figures.of(loop)[""].largest_cm[0] == 9.0


def test_the_change_of_a_controller_counts_for_neither():
    figures, loop = RoundFigures(), loop_of()
    drive_on(figures, loop, [0.5] * 150)
    figures.begin("other")
    drive_on(figures, loop, [50.0] * 49 + [0.25] * 200)
    found = figures.of(loop)
    assert found[""].largest_cm[0] == 0.5
    assert found[""].share < 1.0
    assert found["other"].largest_cm[0] == 0.25
    assert found["other"].share == 1.0


def test_what_is_driven_elsewhere_breaks_a_round_off():
    figures, loop = RoundFigures(), loop_of()
    drive_on(figures, loop, [0.5] * 150)
    drive_on(figures, None, [50.0] * 10)
    drive_on(figures, loop, [0.25] * 100)
    assert figures.of(loop)[""].share == pytest.approx(0.5)
    assert figures.of(loop)[""].largest_cm[0] == 0.25


def test_a_round_in_which_nobody_answers_is_broken_off():
    figures, loop = RoundFigures(), loop_of()
    drive_on(figures, loop, [0.5] * 150)
    figures.break_off()
    drive_on(figures, loop, [0.25] * 100)
    assert figures.of(loop)[""].share == pytest.approx(0.5)


def test_rounds_of_another_motion_are_others_and_those_of_the_same_are_found_again():
    figures, loop = RoundFigures(), loop_of()
    drive_on(figures, loop, [0.5] * 200)
    other = loop_of("other")
    assert figures.of(other) == {}
    drive_on(figures, other, [2.0] * 200)
    assert figures.of(loop_of())[""].largest_cm[0] == 0.5
    figures.forget("")
    assert figures.of(loop) == figures.of(other) == {}


@pytest.mark.parametrize("closed", [True, False])
def test_the_drive_counts_a_whole_round_of_closed_and_open_motions(closed):
    robot = load_robot("asimo")
    full = load_motion("eight", robot)
    motion = Motion("part", full.times_s[:20], full.targets[:20], closed=closed)
    drive = Drive(robot)
    drive.change_controller("teacher")
    loop = drive.go_through(motion)
    ticks = round(3 * loop.duration_s / TICK_S)
    for number in range(ticks):
        drive.answer()
        drive.take(START_NS + number * TICK_NS, robot.comfort)
    found = drive.rounds()["teacher"]
    assert found.is_whole
    assert found.mean.ticks * TICK_S == pytest.approx(loop.duration_s, abs=0.1)
    assert (found.largest_cm >= found.mean.hands_cm).all()


def test_a_drive_that_is_lent_asks_nothing_and_goes_on_afterwards():
    robot = load_robot("asimo")
    drive = Drive(robot)
    drive.go_through(load_motion("eight", robot))
    assert drive.take(START_NS, robot.comfort) is not None
    drive.lend(lent=True)
    assert drive.snapshot().mode is Mode.LENT
    drive.move_hand(0, drive.snapshot().hands[0] + 0.05)
    assert [drive.take(START_NS + number * TICK_NS, robot.comfort) for number in range(1, 5)] == [None] * 4
    drive.lend(lent=False)
    tick = drive.take(START_NS + 5 * TICK_NS, robot.comfort)
    assert tick.begins
    assert np.array_equal(tick.rows, drive.snapshot().hands)
    assert drive.snapshot().mode is Mode.HANDLES
