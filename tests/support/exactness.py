"""Trains on a small log and prints its digests, and beside them bits that do depend on the machine; run as a script."""

import hashlib
import json
import math
import sys
from pathlib import Path

import numba
import numpy as np


def bits(values: object) -> str:
    return hashlib.sha256(np.ascontiguousarray(values, dtype="<f8").tobytes()).hexdigest()[:16]


@numba.njit(fastmath=True)
def reordered_sum(values: np.ndarray) -> float:
    total = 0.0
    for value in values:
        total += value * 0.1
    return total


def controls() -> dict[str, str]:
    """Return bits that are free to change with the machine: each shows that a row of the matrix reached its code."""
    values = np.random.default_rng(0).standard_normal(200_000)
    square = values[:160_000].reshape(400, 400)
    return {
        "libm": bits([[math.sin(v), math.exp(v), math.pow(abs(v), 0.3)] for v in values[:20_000].tolist()]),
        "numpy": bits(np.tanh(np.sin(values))),
        "compiler": bits([reordered_sum(values[i:]) for i in range(64)]),
        "blas": bits(square @ square),
        "dot": bits([np.dot(values[i:], values[: len(values) - i]) for i in range(64)]),
    }


def main() -> None:
    sys.path.insert(0, str(Path(__file__).parents[2]))
    from pipeline.learner.rules.forward_inverse.config import ForwardInverseConfig
    from pipeline.learner.rules.reservoir.config import LearnerConfig
    from pipeline.training.trainer import train
    from replay.sources.schedule import Schedule

    quadratic = ForwardInverseConfig(degree=2, forgetting=0.99)
    runs = (LearnerConfig(seed=0), None), (ForwardInverseConfig(), None), (quadratic, None), (quadratic, "computed")
    log, schedule = Path(sys.argv[1]), Schedule(epochs=2)
    results = [train([log], schedule=schedule, config=config, pairs=pairs).result() for config, pairs in runs]
    digests = [result[name] for result in results for name in ("digest", "stream_digest")]
    print(json.dumps({"digests": digests, "controls": controls()}))


if __name__ == "__main__":
    main()
