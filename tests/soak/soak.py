"""Runs robot, controller, learner and recorder for hours: python tests/soak/soak.py [--hours H] [--real-time] ...

Every few seconds it notes of each process the memory, descriptors and threads, and the counts of its status; finished
parts of the recording are counted and removed on the way. At the end it compares what was sent with what every node
has taken, message by message, and gives the slope of each process's memory with its 99 % interval. Into the folder
`--out` go `samples.jsonl`, `result.json` and `soak.png`. Exit status 1 if anything was missed or grows.

Without --real-time the robot's time is simulated: it is the program's robot node in lockstep, but joints without Drake
behind it, so that a day passes in less than an hour. With it the program's own simulated robot runs with the clock.
"""

import argparse
import json
import time
from collections import Counter
from contextlib import ExitStack
from dataclasses import asdict
from pathlib import Path
from typing import Any

import zenoh
from process_sample import process_sample
from soak_nodes import RECORDING, Nodes, SoakConfig, learned_controller, running_nodes
from soak_picture import draw
from soak_verdict import verdict

from pipeline.terminal.signals import end_by_exceptions
from recorders.nodes.search import find_nodes
from recorders.nodes.status import NodeStatus
from recorders.reading.reader import LogReader
from recorders.wire.keys.namespace import DEFAULT_NAMESPACE
from recorders.wire.loopback import free_endpoint
from recorders.wire.session import SessionConfig, open_session

_ANSWER_S, _QUIET_LOOKS, _PRINT_EVERY = 10.0, 5, 60
_REST_S = 1.0


class Soak:
    """A soak under way: its nodes, what has been noted of them, and what of the recording has been counted."""

    def __init__(self, folder: Path, nodes: Nodes, session: zenoh.Session, config: SoakConfig) -> None:
        self._folder, self._nodes, self._session, self._config = folder, nodes, session, config
        self._began_s = time.monotonic()
        self.samples: list[dict[str, Any]] = []
        self.recorded: Counter[str] = Counter()
        self.parts = 0

    def run(self) -> dict[str, Any]:
        """Drive to the end, end all nodes, and return what each has counted."""
        driver = self._nodes.processes["explorer"]
        with (self._folder / "samples.jsonl").open("w") as file:
            while driver.poll() is None:
                self._nodes.check()
                sample = self._sample()
                print(json.dumps(sample), file=file, flush=True)
                self._take_parts(self._finished_parts())
                self._report(sample)
                time.sleep(self._config.every_s)
        self._nodes.check()
        del self._nodes.processes["explorer"]
        driven = json.loads(self._nodes.output("explorer"))
        counts = self._settled()
        return {"driven": driven, "counts": counts} | self._end()

    def _sample(self) -> dict[str, Any]:
        counts = self._statuses()
        sample = {
            "time_s": time.monotonic() - self._began_s,
            "processes": {kind: process_sample(p.pid)._asdict() for kind, p in self._nodes.processes.items()},
            "counts": {kind: dict(status.counts) for kind, status in counts.items()},
        }
        self.samples.append(sample)
        return sample

    def _statuses(self) -> dict[str, NodeStatus]:
        found = find_nodes(self._session, namespace=DEFAULT_NAMESPACE, timeout_s=_ANSWER_S)
        return {status.kind: status for status in found}

    def _settled(self) -> dict[str, Any]:
        """Return the counts of all nodes once those that count ticks no longer change."""
        kinds, seen, same = ("controller", "learner"), {}, 0
        while same < _QUIET_LOOKS:
            time.sleep(_REST_S)
            counts = {kind: dict(status.counts) for kind, status in self._statuses().items()}
            now = {kind: counts.get(kind) for kind in kinds}
            seen, same = now, same + 1 if now == seen else 0
        return counts

    def _end(self) -> dict[str, Any]:
        """End the nodes, the recorder last, and return how, what the learner has learned and what is in the log."""
        statuses = {kind: self._nodes.end(kind) for kind in ("learner", "controller", "robot", "recorder")}
        self._take_parts(sorted(self._folder.glob(self._parts_pattern)))
        recording = json.loads(self._nodes.output("recorder"))
        recording = {name: recording[name] for name in ("messages", "gaps", "refused", "broken")}
        learned = json.loads(self._nodes.output("learner"))["ticks"]
        log = {"messages": dict(self.recorded), "parts": self.parts}
        return {"exit": statuses, "learned_ticks": learned, "recording": recording, "log": log}

    @property
    def _parts_pattern(self) -> str:
        return f"{Path(RECORDING).stem}_*.mcap"

    def _finished_parts(self) -> list[Path]:
        return sorted(self._folder.glob(self._parts_pattern))

    def _take_parts(self, paths: list[Path]) -> None:
        """Count the messages of finished parts, by topic, and remove them: the whole would fill a disk."""
        for path in paths:
            self.recorded += Counter(LogReader(path).counts)
            self.parts += 1
            path.unlink()

    def _report(self, sample: dict[str, Any]) -> None:
        if len(self.samples) % _PRINT_EVERY != 1:
            return
        ticks = sample["counts"].get("explorer", {}).get("ticks", 0)
        rate = ticks / max(sample["time_s"], 1e-9)
        left_s = (self._config.ticks - ticks) / rate if rate else float("inf")
        if self._config.real_time:
            left_s = self._config.hours * 3600.0 - sample["time_s"]
        megabytes = {kind: round(process["resident"] / 1e6) for kind, process in sample["processes"].items()}
        print(
            f"{ticks} of {self._config.ticks} ticks, {rate:.0f} a second, "
            f"{rate / self._config.rate_hz:.1f} times real time, {left_s / 60:.0f} min left; MB: {megabytes}",
            flush=True,
        )


def soak(folder: Path, config: SoakConfig) -> dict[str, Any]:
    """Run a soak in a folder, and return its result."""
    folder.mkdir(parents=True, exist_ok=True)
    for path in folder.glob(f"{Path(RECORDING).stem}_*"):
        path.unlink()
    learned_controller(folder)
    endpoint = free_endpoint()
    with ExitStack() as stack:
        nodes = stack.enter_context(running_nodes(folder, endpoint, config))
        session = stack.enter_context(open_session(SessionConfig(connect=(endpoint,), wait_s=120.0)))
        nodes.await_kinds(session)
        nodes.start_script("explorer", "tick_driver.py", config.hours, config.rate_hz, config.mode)
        running = Soak(folder, nodes, session, config)
        ended = running.run()
    result = {"config": asdict(config), **ended, **verdict(running.samples, ended, config)}
    (folder / "result.json").write_text(json.dumps(result, indent=1) + "\n")
    draw(running.samples, result, folder / "soak.png")
    return result


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    default = SoakConfig()
    parser.add_argument("--hours", type=float, default=default.hours, help="of the robot's time, or of the clock")
    parser.add_argument("--rate", type=float, default=default.rate_hz, help="ticks a second of that time [Hz]")
    parser.add_argument("--real-time", action="store_true", help="with the clock on the wall, simulated by Drake")
    parser.add_argument("--every", type=float, default=default.every_s, help="seconds between two looks")
    parser.add_argument("--out", type=Path, default=Path("out/soak"))
    given = parser.parse_args()
    result = soak(given.out.resolve(), SoakConfig(given.hours, given.rate, given.real_time, given.every))
    for line in result["findings"]:
        print(line)
    raise SystemExit(0 if result["holds"] else 1)


if __name__ == "__main__":
    end_by_exceptions()  # so that the nodes are ended with it
    main()
