"""Baseline: a random network of scaled targets, whose readout learns by recursive least squares.

H. Jaeger, "The echo state approach to analysing and training recurrent neural networks", GMD Report 148 (2001).
"""

import numpy as np

from pipeline.arrays import Floats
from pipeline.paper.comparison.regressions import RIDGE, Answer
from pipeline.seeding import uniforms

NEURONS = 300  # as the paper's
_INPUT_RANGE, _BIAS_RANGE, _RECURRENT_RANGE = 0.5, 0.5, 0.005


class EchoState:
    """Network of tanh neurons that has the present target, and what it did at the last one.

    Parameters
    ----------
    inputs : int
        Numbers of a target.
    seed : int
        Names the draws.
    """

    def __init__(self, inputs: int, seed: int) -> None:
        self._inputs = self._drawn(seed, "inputs", (NEURONS, inputs), _INPUT_RANGE)
        self._bias = self._drawn(seed, "bias", (NEURONS,), _BIAS_RANGE)
        self._recurrent = self._drawn(seed, "recurrent", (NEURONS, NEURONS), _RECURRENT_RANGE)
        self._state = np.zeros(NEURONS)

    @staticmethod
    def _drawn(seed: int, name: str, shape: tuple[int, ...], limit: float) -> Floats:
        drawn = uniforms(seed, "echo-state", name, count=int(np.prod(shape)))
        return np.asarray(limit * (2.0 * drawn - 1.0)).reshape(shape)

    def features(self, target: Floats) -> Floats:
        """Take a step: return 1, the scaled target (v,) and the activities."""
        self._state = np.tanh(self._inputs @ target + self._recurrent @ self._state + self._bias)
        return np.concatenate([[1.0], target, self._state])


def echo_state(targets: Floats, joints: Floats, seed: int) -> Answer:
    """Fit the readout in one pass, sample by sample."""
    network = EchoState(targets.shape[1], seed)
    size = 1 + targets.shape[1] + NEURONS
    covariance, weights = np.eye(size) / RIDGE, np.zeros((size, joints.shape[1]))
    for target, wanted in zip(targets, joints, strict=True):
        features = network.features(target)
        gain = covariance @ features
        scale = 1.0 / (1.0 + float(features @ gain))
        weights += np.outer(gain, (wanted - features @ weights) * scale)
        covariance -= np.outer(gain, gain) * scale

    return lambda u: np.array([network.features(target) @ weights for target in u])
