"""Deviations that do not hold on a motion are doubted in a line."""

import numpy as np
import pytest

from pipeline.evaluation.errors import HandErrors
from pipeline.evaluation.trials import LEAST_WITHIN, Trial

DISTANCE_M = 0.1
COUNT = 10


def trial(within: int) -> Trial:
    """Return a trial of one hand, with so many of ten distances within a deviation."""
    asked = np.zeros((COUNT, 1, 3))
    reached = asked + np.array([DISTANCE_M, 0.0, 0.0])
    deviations = np.where(np.arange(COUNT) < within, 2.0, 0.5)[:, np.newaxis] * DISTANCE_M
    errors = HandErrors(mean_cm=10.0, max_cm=10.0, hands_cm={"hand": 10.0}, hands_max_cm={"hand": 10.0}, samples=COUNT)
    return Trial("motion", asked[:, 0], asked, np.zeros((COUNT, 2)), reached, errors, deviations=deviations)


@pytest.mark.parametrize("within", [0, 1, 2])
def test_deviations_within_which_few_distances_are_are_doubted(within: int) -> None:
    expected = f"not to be relied on here: {within / COUNT:.0%} of the distances are within one deviation"
    assert trial(within).doubt.startswith(expected)


@pytest.mark.parametrize("within", [round(LEAST_WITHIN * COUNT), 6, 10])
def test_deviations_that_hold_are_not(within: int) -> None:
    assert trial(within).doubt == ""
