"""Baselines find what they can express, by the formula or sample by sample, and miss what they cannot."""

import sys

import numpy as np
import pytest
import scipy.linalg

from pipeline.paper.comparison.echo_state import NEURONS, EchoState, echo_state
from pipeline.paper.comparison.regressions import (
    RIDGE,
    kernel_ridge,
    library_kernel_ridge,
    library_perceptron,
    polynomial_ridge,
)

VARIABLES = 3
RANDOM = np.random.default_rng(7)
SEEN, ASKED = RANDOM.uniform(-1.0, 1.0, (300, VARIABLES)), RANDOM.uniform(-1.0, 1.0, (50, VARIABLES))


def curved(u, degree):
    """Two outputs of exactly this total degree."""
    x, y, z = u.T
    return np.stack([x * y ** (degree - 1) + 0.3, z**degree - 0.5 * x], axis=1)


@pytest.mark.parametrize("degree", [1, 3, 4])
def test_a_polynomial_of_its_degree_is_found(degree: int) -> None:
    answer = polynomial_ridge(degree)(SEEN, curved(SEEN, degree), 0)
    np.testing.assert_allclose(answer(ASKED), curved(ASKED, degree), atol=1e-4)


@pytest.mark.parametrize("degree", [1, 3])
def test_a_polynomial_of_a_higher_degree_is_not(degree: int) -> None:
    answer = polynomial_ridge(degree)(SEEN, curved(SEEN, degree + 1), 0)
    assert np.abs(answer(ASKED) - curved(ASKED, degree + 1)).max() > 0.05


@pytest.mark.parametrize("fit", [kernel_ridge, echo_state])
def test_smooth_functions_are_found_where_samples_are(fit) -> None:
    answer = fit(SEEN, curved(SEEN, 2), 0)
    assert np.sqrt(np.square(answer(ASKED) - curved(ASKED, 2)).mean()) < 0.03
    np.testing.assert_array_equal(fit(SEEN, curved(SEEN, 2), 0)(ASKED), fit(SEEN, curved(SEEN, 2), 0)(ASKED))


def test_the_readout_that_learns_sample_by_sample_is_ridge_regression() -> None:
    network, wanted = EchoState(VARIABLES, 3), curved(SEEN, 2)
    features = np.array([network.features(target) for target in SEEN])
    square = features.T @ features + RIDGE * np.eye(1 + VARIABLES + NEURONS)
    weights = scipy.linalg.solve(square, features.T @ wanted, assume_a="pos")
    later = np.array([network.features(target) for target in ASKED])
    np.testing.assert_allclose(echo_state(SEEN, wanted, 3)(ASKED), later @ weights, atol=1e-6)


@pytest.mark.parametrize("fit", [library_kernel_ridge, library_perceptron])
def test_scikit_learns_find_it_too_where_it_is_installed(fit) -> None:
    pytest.importorskip("sklearn")
    answer = fit(SEEN, curved(SEEN, 2), 0)
    assert np.sqrt(np.square(answer(ASKED) - curved(ASKED, 2)).mean()) < 0.05


@pytest.mark.parametrize("fit", [library_kernel_ridge, library_perceptron])
def test_scikit_learns_name_it_where_it_is_not(fit, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("sklearn", "sklearn.kernel_ridge", "sklearn.neural_network"):
        monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(ModuleNotFoundError) as missing:
        fit(SEEN, curved(SEEN, 2), 0)
    assert missing.value.name.partition(".")[0] == "sklearn"
