"""Baselines from targets to joints in one formula: polynomials and kernels by SciPy, and scikit-learn's, if installed.

All of them see scaled numbers: targets by the robot's reach, joints by their ranges. Nothing of this feeds a learner.
"""

import warnings
from collections.abc import Callable
from functools import partial
from typing import Any, TypeAlias

import numpy as np
import scipy.linalg
import scipy.spatial.distance
import scipy.special

from pipeline.arrays import Floats
from pipeline.learner.rules.forward_inverse.features import make_features

Answer: TypeAlias = Callable[[Floats], Floats]
"""Scaled joints (T, n) to scaled targets (T, v), which follow one another in time."""

Fit: TypeAlias = Callable[[Floats, Floats, int], Answer]
"""Fits scaled targets (T, v) and joints (T, n), with a seed of whatever is drawn."""

RIDGE = 1e-4
"""Of the polynomials, in units of the noise's variance."""

_KERNEL_RIDGE, _KERNEL_GAMMA = 1e-4, 0.05  # the least leave-one-out error on an exploration
_LAYERS = (100, 100)
_ITERATIONS = 300


def polynomial_ridge(degree: int) -> Fit:
    """Return ridge regression on products of Legendre polynomials of the target, up to a total degree."""
    return partial(_polynomial, degree)


def _polynomial(degree: int, targets: Floats, joints: Floats, seed: int) -> Answer:
    variables = targets.shape[1]
    products = make_features(variables, degree).products
    powers = np.array([[product.count(v) for v in range(variables)] for product in products])  # (features, v)

    def features(u: Floats) -> Floats:
        """Return the features (T, n) of targets."""
        values = scipy.special.eval_legendre(np.arange(degree + 1), u[:, :, np.newaxis])  # (T, v, degree + 1)
        return np.asarray(values[:, np.arange(variables), powers].prod(axis=2))

    seen = features(targets)
    square = seen.T @ seen + RIDGE * np.eye(len(products))
    weights = scipy.linalg.solve(square, seen.T @ joints, assume_a="pos")
    return lambda u: features(u) @ weights


def kernel_ridge(targets: Floats, joints: Floats, seed: int) -> Answer:
    """Fit ridge regression with a Gaussian kernel."""

    def kernel(u: Floats) -> Floats:
        """Return the kernel (T, samples) between targets and samples."""
        return np.asarray(np.exp(-_KERNEL_GAMMA * scipy.spatial.distance.cdist(u, targets, "sqeuclidean")))

    square = kernel(targets) + _KERNEL_RIDGE * np.eye(len(targets))
    weights = scipy.linalg.solve(square, joints, assume_a="pos")
    return lambda u: kernel(u) @ weights


def library_kernel_ridge(targets: Floats, joints: Floats, seed: int) -> Answer:
    """Fit scikit-learn's kernel ridge regression, with the same kernel; ModuleNotFoundError if it is not installed."""
    from sklearn.kernel_ridge import KernelRidge  # noqa: PLC0415  # an extra

    return _predict(KernelRidge(kernel="rbf", alpha=_KERNEL_RIDGE, gamma=_KERNEL_GAMMA).fit(targets, joints))


def library_perceptron(targets: Floats, joints: Floats, seed: int) -> Answer:
    """Fit scikit-learn's multi-layer perceptron; ModuleNotFoundError if it is not installed."""
    from sklearn.exceptions import ConvergenceWarning  # noqa: PLC0415  # an extra
    from sklearn.neural_network import MLPRegressor  # noqa: PLC0415

    network = MLPRegressor(
        hidden_layer_sizes=_LAYERS, solver="lbfgs", alpha=RIDGE, max_iter=_ITERATIONS, random_state=seed
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)  # so many iterations, and no more
        return _predict(network.fit(targets, joints))


def _predict(model: Any) -> Answer:
    return lambda u: np.asarray(model.predict(u))
