"""Computes runs on a Dask cluster in a process of its own, and ends as the command line does.

Arguments: scheduler's address, how long to wait for a worker [s], log, number of runs, epochs of each. Writes a line
for each finished run, and at the end the digests. Every run but the first waits for a file `go on` beside the log.
"""

import sys
from functools import partial
from pathlib import Path

from run_events import holding

from pipeline.learner.rules.reservoir.config import LearnerConfig
from pipeline.training.batch import Run, compute_all
from pipeline.training.executors import dask_cluster
from recorders.errors import ReenactError
from replay.sources.schedule import Schedule


def main(address: str, wait_s: str, log: str, count: str, epochs: str) -> None:
    runs = [Run((Path(log),), Schedule(epochs=int(epochs)), LearnerConfig(seed=seed)) for seed in range(int(count))]
    cluster = partial(dask_cluster, address, worker_wait_s=float(wait_s))
    executors = partial(holding, cluster, Path(log).with_name("begun"), Path(log).with_name("go on"))
    try:
        outcomes = compute_all(runs, executors, on_done=lambda done: print("done", done, flush=True))
    except ReenactError as error:
        print(f"reenact: {error}", file=sys.stderr)
        sys.exit(error.exit_status)
    print(*(outcome.digest for outcome in outcomes))


if __name__ == "__main__":
    main(*sys.argv[1:])
