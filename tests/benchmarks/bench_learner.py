"""One training step of ours beside reservoirpy's, same sizes, same run: python tests/benchmarks/bench_learner.py.

Beside them stand the steps and the commands of the rule `forward-inverse`, with the robot `asimo`.

Ours is a complete step: forward with output feedback, BPDC, IP. reservoirpy's is its forward and IP step
(`IPReservoir.partial_fit`) plus its LMS step (`LMS.partial_fit` on states computed beforehand), no output feedback.
A plain numba loop over dense matrices, vectorised across neurons, shows what sparse tables are worth. Repetitions of
all three are interleaved, so that a slow moment of the machine hits all of them. Nothing is asserted.
"""

import statistics
import time
import warnings
from collections.abc import Callable

import numba
import numpy as np
from reservoirpy.nodes import LMS, IPReservoir

from pipeline.learner.body import body_of
from pipeline.learner.rules.forward_inverse.config import ForwardInverseConfig
from pipeline.learner.rules.forward_inverse.learner import ForwardInverseLearner
from pipeline.learner.rules.reservoir.config import LearnerConfig
from pipeline.learner.rules.reservoir.learner import Learner
from pipeline.robot.config import load_robot
from pipeline.robot.kinematics import Kinematics

CONFIG = LearnerConfig()
STEPS = 256
REPETITIONS = 25


def data() -> tuple[np.ndarray, np.ndarray]:
    phase = np.arange(STEPS)[:, np.newaxis] * (2.0 * np.pi / 64.0)
    u = 0.1 * np.sin(phase * [1, 2, 3, 1, 2, 3] + np.arange(CONFIG.inputs))
    return u, np.tanh(u @ np.random.default_rng(0).uniform(-2.0, 2.0, (CONFIG.inputs, CONFIG.outputs)))


def ours(u: np.ndarray, d: np.ndarray) -> Callable[[], object]:
    learner = Learner(CONFIG, input_centre=np.zeros(CONFIG.inputs), output_centre=np.zeros(CONFIG.outputs))
    return lambda: learner.step(u, d, learning=True)


def forward_inverse(*, learning: bool) -> Callable[[], object]:
    robot = load_robot("asimo")
    centre = np.concatenate([robot.input_centre, robot.comfort])
    config = ForwardInverseConfig().with_body(body_of(robot))
    learner = ForwardInverseLearner(config, input_centre=robot.input_centre, output_centre=centre)
    span = robot.upper - robot.lower
    q = robot.comfort + 0.1 * span * np.random.default_rng(0).uniform(-1.0, 1.0, (STEPS, len(span)))
    hands = Kinematics(robot).hands_along(q).reshape(STEPS, -1)
    taught = np.concatenate([hands, q], axis=1)
    learner.step(hands, taught, learning=True)
    return (lambda: learner.step(hands, taught, learning=True)) if learning else (lambda: learner.predict(hands))


def reservoirpys(u: np.ndarray, d: np.ndarray) -> Callable[[], object]:
    reservoir = IPReservoir(
        CONFIG.reservoir,
        mu=CONFIG.ip_mu,
        learning_rate=0.0025,
        activation="sigmoid",
        input_connectivity=CONFIG.input_reservoir_density,
        rc_connectivity=CONFIG.reservoir_reservoir_density,
        seed=0,
    )
    readout = LMS(learning_rate=1e-4)
    states = reservoir.run(u)

    def step() -> None:
        reservoir.partial_fit(u)
        readout.partial_fit(states, d)

    return step


@numba.njit(error_model="numpy")
def dense_steps(u, d, w, v, z, x, out, a, b):
    """Dense and source-major: w (sources, reservoir), v (sources, outputs), z = (u, y of outputs, y of reservoir)."""
    inputs, first = u.shape[1], u.shape[1] + d.shape[1]
    for k in range(len(u)):
        z[:inputs] = u[k]
        x[:], out[:], norm = 0.0, 0.0, 0.0
        for j in range(z.size):
            norm += z[j] * z[j]
            for i in range(x.size):
                x[i] += w[j, i] * z[j]
            for i in range(out.size):
                out[i] += v[j, i] * z[j]
        for j in range(z.size):
            rate = 0.1 / (norm + 0.002) * z[j]
            for i in range(out.size):
                v[j, i] -= rate * (out[i] - d[k, i])
        for i in range(out.size):
            z[inputs + i] = 1.0 / (1.0 + np.exp(-out[i]))
        for i in range(x.size):
            y = 1.0 / (1.0 + np.exp(-a[i] * x[i] - b[i]))
            delta = 0.0025 * (1.0 - 12.0 * y + 10.0 * y * y)
            a[i] += 0.0025 / a[i] + x[i] * delta
            b[i] += delta
            z[first + i] = y


def dense(u: np.ndarray, d: np.ndarray) -> Callable[[], object]:
    n, outputs = CONFIG.reservoir, CONFIG.outputs
    sources = CONFIG.inputs + outputs + n
    rng = np.random.default_rng(0)
    w, v = rng.uniform(-0.01, 0.01, (sources, n)), rng.uniform(-0.1, 0.1, (sources, outputs))
    arrays = np.zeros(sources), np.zeros(n), np.zeros(outputs), np.ones(n), np.zeros(n)
    return lambda: dense_steps(u, d, w, v, *arrays)


def microseconds_a_step(function: Callable[[], object]) -> float:
    start = time.perf_counter()
    function()
    return (time.perf_counter() - start) / STEPS * 1e6


def main() -> None:
    warnings.simplefilter("ignore")
    u, d = data()
    subjects = {
        "reenact": ours(u, d),
        "reservoirpy": reservoirpys(u, d),
        "dense numba": dense(u, d),
        "forward-inverse": forward_inverse(learning=True),
        "its commands": forward_inverse(learning=False),
    }
    for function in subjects.values():
        function()  # compile, initialise
    times: dict[str, list[float]] = {name: [] for name in subjects}
    for _ in range(REPETITIONS):
        for name, function in subjects.items():
            times[name].append(microseconds_a_step(function))
    ratios = {
        name: statistics.median(a / b for a, b in zip(times[name], times["reenact"], strict=True)) for name in subjects
    }
    print(f"training step, {CONFIG.reservoir} neurons, {CONFIG.inputs} inputs, {CONFIG.outputs} outputs")
    for name, values in times.items():
        print(
            f"{name:15s} {statistics.median(values):8.2f} us (best {min(values):.2f})   {ratios[name]:6.1f} x reenact"
        )


if __name__ == "__main__":
    main()
