"""Training streamed over Zenoh beside training from the file: python tests/benchmarks/bench_stream.py [--epochs 150].

Pattern 1 (T = 256), six cycles of seven a run and one evaluated, the learner in a process of its own on loopback. The
file side reads the log anew for every presentation and, as the learner always does, joins and digests it. Both sides
are compiled beforehand, and take turns, so that a slow moment of the machine hits both. Nothing is asserted but that
they agree.
"""

import argparse
import statistics
import subprocess
import sys
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "support"))
from episodes import write_episode

from pipeline.learner.rules.reservoir.config import LearnerConfig
from pipeline.training.trainer import Trainer, train, train_on
from recorders.wire.loopback import free_endpoint
from recorders.wire.receiver import Receiver
from recorders.wire.session import SessionConfig, open_session
from replay.sources import scheduled
from replay.sources.schedule import Schedule
from replay.transports.zenoh import ZenohTransport

SAMPLES = 256


def learn(endpoint: str, log: Path) -> None:
    """Learn from one stream after another, until the input is closed."""
    train([log], schedule=Schedule(epochs=1), config=LearnerConfig())  # compile
    with open_session(SessionConfig(listen=(endpoint,))) as session:
        print("ready", flush=True)
        while sys.stdin.readline():
            with Receiver(session) as receiver:
                print("waiting", flush=True)
                receiver.serve(Trainer(LearnerConfig()))
                print("learned", flush=True)


class Streamed:
    """Feeds the learner in the other process, until the stack is closed."""

    def __init__(self, log: Path, schedule: Schedule, stack: ExitStack) -> None:
        self._source = scheduled.Replay([log], schedule)
        endpoint = free_endpoint()
        arguments = [sys.executable, __file__, "--learn", endpoint, str(log)]
        self._learner = stack.enter_context(
            subprocess.Popen(arguments, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        )
        stack.callback(self._learner.kill)
        self._await("ready")
        self._session = stack.enter_context(open_session(SessionConfig(connect=(endpoint,))))

    def run(self) -> tuple[float, str]:
        """Return seconds and state digest of one training."""
        assert self._learner.stdin is not None
        self._learner.stdin.write("\n")
        self._learner.stdin.flush()
        self._await("waiting")
        begin = time.perf_counter()
        result = ZenohTransport(self._session).deliver(self._source.offer(), self._source.stream)["learner"]
        took = time.perf_counter() - begin
        self._await("learned")
        return took, str(result["digest"])

    def _await(self, word: str) -> None:
        assert self._learner.stdout is not None
        if self._learner.stdout.readline() != f"{word}\n":
            raise SystemExit("the learner ended")


class FromFile:
    """Trains in this process and reads the log again for every presentation."""

    def __init__(self, log: Path, schedule: Schedule) -> None:
        kept, scheduled.CACHE_BYTES = scheduled.CACHE_BYTES, 0
        self._source = scheduled.Replay([log], schedule)
        scheduled.CACHE_BYTES = kept

    def run(self) -> tuple[float, str]:
        """Return seconds and state digest of one training."""
        begin = time.perf_counter()
        trainer = train_on(self._source, Trainer(LearnerConfig()))
        digest = str(trainer.result()["digest"])
        return time.perf_counter() - begin, digest


def main(epochs: int, repetitions: int) -> None:
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        log = write_episode(folder / "log.mcap", samples=SAMPLES)
        train([log], schedule=Schedule(epochs=1), config=LearnerConfig())  # compile
        schedule = Schedule(epochs=epochs)
        sides: dict[str, FromFile | Streamed] = {
            "from the file": FromFile(log, schedule),
            "over Zenoh": Streamed(log, schedule, stack),
        }
        times: dict[str, list[float]] = {name: [] for name in sides}
        digests = set()
        for turn in range(repetitions):
            for name in sorted(sides, reverse=bool(turn % 2)):
                seconds, digest = sides[name].run()
                times[name].append(seconds)
                digests.add(digest)
    if len(digests) != 1:
        raise SystemExit(f"expected one state, found {len(digests)}")
    print(f"{epochs} epochs of pattern 1, {repetitions} times; one state on both sides")
    for name, values in times.items():
        print(f"{name:14s} {statistics.median(values):6.2f} s   ({min(values):.2f} to {max(values):.2f})")
    ratios = [a / b for a, b in zip(times["over Zenoh"], times["from the file"], strict=True)]
    print(f"over Zenoh takes {statistics.median(ratios):.2f} times as long ({min(ratios):.2f} to {max(ratios):.2f})")


if __name__ == "__main__":
    if sys.argv[1:2] == ["--learn"]:
        learn(sys.argv[2], Path(sys.argv[3]))
    else:
        parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
        parser.add_argument("--epochs", type=int, default=150)
        parser.add_argument("--repetitions", type=int, default=3)
        arguments = parser.parse_args()
        main(arguments.epochs, arguments.repetitions)
