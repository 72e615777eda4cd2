"""Trains, aligns and converts as users do, and prints a digest of each result: python exact_digests.py INPUTS OUT.

Run on two machines over the same inputs (`write_inputs`), it prints the same lines: one JSON object each, the golden
cases last. It needs the core alone.
"""

import hashlib
import io
import json
import sys
from collections.abc import Iterator
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from typing import Any

import numpy as np

GOLDEN = Path(__file__).parents[2] / "data" / "golden"
FORWARD = ("--rule", "forward-inverse")
TRACKED = ("--map", "/tracker=/hand/tip/measured")

TRAINED: dict[str, tuple[object, ...]] = {
    "reservoir": (GOLDEN / "circles" / "circles_40.mcap", "--epochs", 3),
    "reservoir, two logs": (*sorted((GOLDEN / "two_logs").glob("*.mcap")), "--epochs", 2),
    "reservoir, reached pairs": (GOLDEN / "forward_inverse" / "volume_50.mcap", "--pairs", "reached", "--epochs", 2),
    "forward-inverse": (GOLDEN / "forward_inverse" / "volume_50.mcap", *FORWARD),
    "forward-inverse, commanded pairs": (
        GOLDEN / "circles" / "circles_40.mcap", *FORWARD, "--pairs", "commanded"
    ),
    "forward-inverse, computed pairs": (
        GOLDEN / "forward_inverse" / "volume_50.mcap", *FORWARD, "--pairs", "computed"
    ),
}  # fmt: skip
"""Options of `train` for logs that carry ticks."""

ALIGNED: dict[str, tuple[str, tuple[object, ...]]] = {
    "by the tracker's stamps": ("position", (*TRACKED, "--ticks-of", "/tracker")),
    "by the tracker, at 25 Hz": ("position", (*TRACKED, "--tick-rate", 25, "--latency", "/tracker=0.007")),
    "by kinematics": ("position", ("--tick-rate", 50, "--pairs", "computed")),
    "poses, by the tracker": ("pose", (*TRACKED, "--ticks-of", "/tracker")),
    "poses, by the tracker, turned frame": (
        "pose", (*TRACKED, "--tick-rate", 25, "--frame", "/tracker=0.01,0.02,-0.01,0,0,0.05,0.9987492177719089")
    ),
    "poses, by kinematics": ("pose", ("--tick-rate", 50, "--pairs", "computed")),
}  # fmt: skip
"""For a recording of others: whether its robot controls positions or poses, and how it is aligned."""


def write_inputs(folder: Path) -> None:
    """Write the robots and their recordings: with libm, so on one machine alone."""
    from lab import recording
    from more_hands import ONE, write_robot
    from sessions import write_foreign

    for controls in ("position", "pose"):
        robot = write_robot(folder / controls, ONE, poses=ONE if controls == "pose" else ())
        write_foreign(folder / f"{controls}.mcap", recording(robot))


def results(inputs: Path, out: Path) -> Iterator[tuple[str, Any, str]]:
    """Yield name and result of everything that must not depend on the machine, and a note on what was left out."""
    from pipeline.learner.controller import Controller

    controller = out / "controller.npz"
    for name, options in TRAINED.items():
        yield f"train: {name}", _train(controller, *options), ""
    for name, (controls, options) in ALIGNED.items():
        there = (inputs / f"{controls}.mcap", "--robot", inputs / controls, *FORWARD)
        yield f"align: {name}", _train(controller, *there, "--epochs", 1, *options), ""
        yield f"align: {name}, controller", Controller.load(controller).digest, ""
        ticks = out / "ticks.mcap"
        _run("convert", *there, *options, "--out", ticks, "--overwrite")
        yield f"convert: {name}", _content(ticks), ""
    _run("convert", inputs / "pose.mcap", "--out", ticks, "--overwrite")
    yield "convert: as it is", _content(ticks), ""
    yield "hands of 1000 postures", _hands(inputs / "pose"), ""
    for case in json.loads(_run("golden", "check", GOLDEN, "--json"))["cases"]:
        yield f"golden: {case.pop('name')}", {**case, "physics": None}, case.get("physics", "")


def _train(controller: Path, *options: object) -> dict[str, Any]:
    found = json.loads(_run("train", *options, "--out", controller, "--overwrite", "--json"))
    return {name: found[name] for name in ("digest", "stream_digest", "steps", "ticks", "pairs")}


def _content(log: Path) -> str:
    """Return the digest of a log's messages; its manifest names the machine, so that the file differs."""
    from recorders.reading.reader import LogReader

    return str(LogReader(log).manifest["content_sha256"])


def _hands(robot: Path) -> str:
    """Return the digest of poses of the hands, as learners take them from kinematics."""
    from pipeline.robot.config import load_robot
    from pipeline.robot.hand_kinematics import HandKinematics

    loaded = load_robot(robot)
    share = (np.arange(1000)[:, None] * np.arange(1, len(loaded.joints) + 1)) % 1024 / 1024.0
    poses = HandKinematics(loaded).poses(loaded.lower + share * (loaded.upper - loaded.lower))
    return hashlib.sha256(b"".join(np.ascontiguousarray(part, dtype="<f8").tobytes() for part in poses)).hexdigest()


def _run(*arguments: object) -> str:
    """Run a verb in this process, and return what it printed."""
    from pipeline.cli import app

    printed, said = io.StringIO(), io.StringIO()
    with redirect_stdout(printed), redirect_stderr(said):
        try:
            app.main(list(map(str, arguments)))
        except SystemExit as end:
            status = end.code
    if status not in (0, None, 1):  # 1: a golden case does not hold, which the result shows
        raise SystemExit(f"reenact {' '.join(map(str, arguments))}: {said.getvalue()}")
    return printed.getvalue()


def main(inputs: Path, out: Path) -> None:
    for name, result, note in results(inputs, out):
        print(json.dumps({"name": name, "result": result, "note": note}), flush=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
