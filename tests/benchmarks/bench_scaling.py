"""Cost of a training step from 100 to 10,000 neurons: python tests/benchmarks/bench_scaling.py [picture.png].

Every neuron of the reservoir keeps as many connections as Table I gives it at 300 neurons: 6 from others, 1.2 from the
inputs, 4.2 from and 4.2 to the outputs. The paper's claim is that forward pass, BPDC and IP together then cost O(N).
Beside it a reservoir that is fully connected within, of O(N^2). Repetitions are interleaved, so that a slow moment of
the machine hits all sizes. Nothing is asserted.
"""

import statistics
import sys
import time
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from pipeline.learner.rules.reservoir.config import LearnerConfig
from pipeline.learner.rules.reservoir.learner import Learner

SPARSE = (100, 200, 300, 500, 1000, 2000, 3000, 5000, 10_000)
DENSE = (100, 200, 300, 500, 1000, 2000)
CONNECTIONS = 6  # from other neurons of the reservoir: Table I's 2 % of 300
STEPS = 64
REPETITIONS = 9


def learner(neurons: int, density: float) -> Learner:
    config = LearnerConfig(reservoir=neurons, reservoir_reservoir_density=density)
    return Learner(config, input_centre=np.zeros(config.inputs), output_centre=np.zeros(config.outputs))


def measured(learners: dict[int, Learner]) -> dict[int, float]:
    """Median time of a step by number of neurons [us]."""
    u = 0.1 * np.sin(np.arange(STEPS)[:, np.newaxis] * 0.1 + np.arange(6))
    d = np.tanh(u @ np.random.default_rng(0).uniform(-2.0, 2.0, (6, 21)))
    times: dict[int, list[float]] = {neurons: [] for neurons in learners}
    for repetition in range(REPETITIONS + 1):
        for neurons, subject in learners.items():
            began = time.perf_counter()
            subject.step(u, d, learning=True)
            if repetition:  # the first compiles and warms up
                times[neurons].append((time.perf_counter() - began) / STEPS * 1e6)
    return {neurons: statistics.median(values) for neurons, values in times.items()}


def slope(times: dict[int, float], *, above: int) -> float:
    """Exponent with which the time grows, over the sizes from `above` on."""
    sizes = [neurons for neurons in times if neurons >= above]
    return float(np.polyfit(np.log(sizes), np.log([times[neurons] for neurons in sizes]), 1)[0])


def draw(path: Path, sparse: dict[int, float], dense: dict[int, float]) -> None:
    figure = Figure((6.4, 4.2), layout="constrained")
    axes = figure.subplots()
    for times, colour, name in (
        (dense, "#D55E00", "fully connected reservoir"),
        (sparse, "#0072B2", f"{CONNECTIONS} connections for each neuron"),
    ):
        axes.plot(list(times), list(times.values()), "o-", color=colour, markersize=4, label=name)
    sizes = np.array(list(sparse))
    line = sparse[1000] / 1000 * sizes
    axes.plot(sizes, line, color="#6B6B6B", linewidth=0.8, linestyle="--", label="in proportion to N")
    axes.set(xscale="log", yscale="log", xlabel="neurons N", ylabel="time of a training step (µs)")
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=150)


def main() -> None:
    path = Path(sys.argv[1] if sys.argv[1:] else "out/bench/scaling.png")
    sparse = measured({neurons: learner(neurons, CONNECTIONS / neurons) for neurons in SPARSE})
    dense = measured({neurons: learner(neurons, 1.0) for neurons in DENSE})
    print(f"training step in us; {CONNECTIONS} connections within the reservoir for each neuron, and all of them")
    for neurons, microseconds in sparse.items():
        full = f"{dense[neurons]:12.1f}" if neurons in dense else f"{'-':>12s}"
        print(f"{neurons:6d} neurons{microseconds:10.2f} ({1000 * microseconds / neurons:5.2f} ns a neuron){full}")
    print(f"from 1000 neurons on the time grows as N^{slope(sparse, above=1000):.2f}")
    draw(path, sparse, dense)
    print(f"drawn: {path}")


if __name__ == "__main__":
    main()
