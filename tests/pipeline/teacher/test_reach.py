"""Samples out of reach are found, and clipped, left out or kept as chosen; nothing nearer than clipped is reached."""

import numpy as np
import pytest

from pipeline.motions.motion import Motion
from pipeline.robot.config import load_robot
from pipeline.robot.kinematics import Kinematics
from pipeline.teacher.reach import bring_within_reach, find_misses, nearest_hands
from pipeline.teacher.teacher import REACH_BOUND_M, Teacher, approach
from recorders.errors import MotionError

ROBOT = load_robot("asimo")
TEACHER = Teacher(Kinematics(ROBOT))
CENTRES = np.stack([ROBOT.centres[0], ROBOT.centres[1]])
RIGHT_ALONE = np.array([False, True])


def with_right_at(*offsets: tuple[float, float, float]) -> Motion:
    targets = np.array([CENTRES + np.array([[0, 0, 0], offset]) for offset in offsets])
    return Motion("reaching", 0.1 * np.arange(len(targets)), targets, closed=False)


OUT_AND_BACK = with_right_at((0, 0, 0), (0, -0.1, 0), (0, -0.6, 0), (0.5, 0, 0), (0, 0, -0.6), (0, -0.1, 0))
OUTSIDE = [2, 3, 4]


def test_all_samples_out_of_reach_are_found() -> None:
    misses = list(find_misses(TEACHER, OUT_AND_BACK.targets))
    assert [miss.sample for miss in misses] == OUTSIDE
    assert all(miss.short_m[1] > 0.05 for miss in misses)


@pytest.mark.parametrize("sample", OUTSIDE)
def test_the_nearest_point_is_reached_and_nothing_nearer_is(sample: int) -> None:
    target = OUT_AND_BACK.targets[sample]
    hands = nearest_hands(TEACHER.kinematics, target, missing=RIGHT_ALONE)
    np.testing.assert_allclose(hands[0], target[0], atol=1e-3)  # the other hand stays where it is wanted
    assert approach(TEACHER, ROBOT.comfort, hands)[1].max() < 1.5 * REACH_BOUND_M
    distance = float(np.linalg.norm(hands[1] - target[1]))
    directions = np.random.default_rng(sample).normal(size=(6, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    for direction in [(hands[1] - target[1]) / distance, *directions]:
        nearer = np.stack([target[0], target[1] + (distance - 2 * REACH_BOUND_M) * direction])
        assert approach(TEACHER, ROBOT.comfort, nearer)[1].max() > REACH_BOUND_M


def test_a_point_within_reach_is_its_own_nearest() -> None:
    target = CENTRES + np.array([[0, 0.1, 0.1], [0, -0.2, 0.2]])
    hands = nearest_hands(TEACHER.kinematics, target, missing=RIGHT_ALONE)
    np.testing.assert_allclose(hands, target, atol=1e-4)


def test_clipping_moves_what_is_out_of_reach_and_nothing_else() -> None:
    motion, found = bring_within_reach(TEACHER, OUT_AND_BACK, choice="clip")
    moved = (motion.targets[:, 1] != OUT_AND_BACK.targets[:, 1]).any(axis=1)
    assert np.flatnonzero(moved).tolist() == OUTSIDE
    np.testing.assert_array_equal(motion.targets[:, 0], OUT_AND_BACK.targets[:, 0])
    np.testing.assert_array_equal(motion.times_s, OUT_AND_BACK.times_s)
    assert (found.handled, found.samples, found.hand) == ("clip", 3, "right")
    assert found.first_s == pytest.approx(0.2)
    assert found.worst_cm is not None
    assert found.worst_cm > 5.0


def test_where_both_hands_are_out_of_reach_both_are_clipped() -> None:
    apart = np.stack([CENTRES, CENTRES + np.array([[0, 0.9, 0], [0, -0.9, 0]])])
    motion = Motion("apart", np.array([0.0, 0.1]), apart, closed=False)
    clipped, found = bring_within_reach(TEACHER, motion, choice="clip")
    assert found.samples == 1
    assert 0.3 < clipped.targets[1, 0, 1] - ROBOT.centres[0][1] < 0.8
    assert 0.3 < ROBOT.centres[1][1] - clipped.targets[1, 1, 1] < 0.8
    assert approach(TEACHER, ROBOT.comfort, clipped.targets[1])[1].max() < 2 * REACH_BOUND_M


def test_skipping_leaves_them_out_and_keeping_leaves_them_in() -> None:
    skipped, found = bring_within_reach(TEACHER, OUT_AND_BACK, choice="skip")
    np.testing.assert_array_equal(skipped.targets, np.delete(OUT_AND_BACK.targets, OUTSIDE, axis=0))
    np.testing.assert_allclose(skipped.times_s, [0.0, 0.1, 0.5])
    kept, found_again = bring_within_reach(TEACHER, OUT_AND_BACK, choice="keep")
    assert kept is OUT_AND_BACK
    assert found.samples == found_again.samples == 3


def test_refusing_names_the_first_and_what_is_missing() -> None:
    with pytest.raises(MotionError, match=r"sample 2 \(t = 0.2 s\) the right hand .* stays 10\.\d cm short") as caught:
        bring_within_reach(TEACHER, OUT_AND_BACK, choice="refuse")
    assert "clip, skip or keep" in str(caught.value)


@pytest.mark.parametrize("choice", ["refuse", "clip", "skip", "keep"])
def test_a_motion_within_reach_stays_what_it_is(choice: str) -> None:
    within = with_right_at((0, 0, 0), (0, -0.2, 0.2))
    motion, found = bring_within_reach(TEACHER, within, choice=choice)
    assert motion is within
    assert (found.handled, found.samples, found.hand) == (choice, 0, None)


def test_too_little_left_and_an_unknown_choice_are_refused() -> None:
    far = with_right_at((0, 0, 0), (2, 0, 0), (3, 0, 0))
    with pytest.raises(MotionError, match="at least two samples within reach, found 1 of 3"):
        bring_within_reach(TEACHER, far, choice="skip")
    with pytest.raises(MotionError, match="expected one of refuse, clip, skip, keep, found 'bend'"):
        bring_within_reach(TEACHER, far, choice="bend")
