"""A live session, its recording replayed, and its recording trained from the file are one learner, to the last bit."""

import json
from contextlib import ExitStack
from pathlib import Path
from subprocess import Popen
from typing import Any

import numpy as np
import pytest
from here import reenact_here
from live import spawn
from processes import reenact, start, wait_for_line

from pipeline.learner.controller import Controller
from pipeline.learner.controller_diff import first_difference
from pipeline.robot.config import load_robot
from recorders.messages.phase import EVALUATE, LEARN, WASHOUT
from recorders.messages.topics import SAMPLE_JOINTS, SESSION_PHASE
from recorders.reading.reader import LogReader
from recorders.wire.loopback import free_endpoint

SAMPLES = 12
PHASES = [[WASHOUT, 1], [LEARN, 5], [EVALUATE, 1]]
CYCLES = 7
SETTLE_NS = 500_000_000
RULES = {"learner": "reservoir", "second": "forward-inverse"}
"""The rule of each learner, by its name."""
PAIRS = {"learner": "commanded", "second": "computed"}
"""The pairs of each: a session that is explored live has no hands as measured, which the second would learn from."""
SAME = ("digest", "stream_digest", "steps", "ticks", "train_cm")


def short_motion(path: Path) -> Path:
    """Twelve samples at 10 Hz of a small circle of the left hand, and a line of the right."""
    robot = load_robot("asimo")
    rows = ["t,lx,ly,lz,rx,ry,rz"]
    for k in range(SAMPLES):
        angle = 2.0 * np.pi * k / SAMPLES
        left = robot.centres[0] + 0.02 * np.array([0.0, np.cos(angle), np.sin(angle)])
        right = robot.centres[1] + 0.02 * np.array([0.0, np.sin(angle), 0.0])
        rows.append(",".join(map(repr, [0.1 * k, *left.tolist(), *right.tolist()])))
    path.write_text("\n".join(rows))
    return path


def settings(name: str) -> tuple[object, ...]:
    """Options of a learner."""
    return ("--rule", RULES[name], "--seed", 5, "--json")


def learners(
    stack: ExitStack, connection: tuple[str, str], out: str, folder: Path, in_ros: tuple[str, ...]
) -> dict[str, Popen[str]]:
    """Start a learner of each rule, and wait until all of them can be awaited."""
    started, others = {}, []
    for name in RULES:
        options = ("--name", name, "--out", f"{name}-{out}.npz", *settings(name))
        started[name] = stack.enter_context(start("learn", *connection, *in_ros, *options, cwd=folder))
        stack.callback(started[name].kill)
        if connection[0] == "--listen":
            wait_for_line(started[name], "waits for a replay")  # the others connect to it
        else:
            others.append(started[name])
        connection = ("--connect", connection[1])
    for process in others:
        wait_for_line(process, "waits for a replay")
    return started


def results(started: dict[str, Popen[str]]) -> dict[str, dict[str, Any]]:
    """Wait for the learners to end, and return what they say."""
    ended = {name: process.communicate(timeout=120) for name, process in started.items()}
    assert {process.returncode for process in started.values()} == {0}, ended
    return {name: json.loads(out) for name, (out, _) in ended.items()}


def live_session(
    motion: str | Path, folder: Path, domain: int | None
) -> tuple[dict[str, Any], dict[str, dict[str, Any]], dict[str, Any]]:
    """Run robot, learners, recorder and explorer, each in a process of its own; return what the last three say."""
    endpoint, in_ros = free_endpoint(), options_of(domain)
    with ExitStack() as stack:

        def run(*arguments: object) -> Popen[str]:
            process = stack.enter_context(start(*arguments, cwd=folder))
            stack.callback(process.kill)
            return process

        wait_for_line(run("robot", "--listen", endpoint, *in_ros), "waits for commands")
        started = learners(stack, ("--connect", endpoint), "live", folder, in_ros)
        options = ("--out", "live.mcap", "--stop-at-stream-end", "--json")
        recorder = run("record", "--connect", endpoint, *in_ros, *options)
        what = "reenact/**" if domain is None else f"all topics of ROS domain {domain}"
        wait_for_line(recorder, f"records {what}")
        explorer = stack.enter_context(
            spawn(
                "explore",
                connect=endpoint,
                motion=str(motion),
                seed=3,
                phases=PHASES,
                settle_ns=SETTLE_NS,
                consumers=[*RULES, "recorder"],
                domain=domain,
            )
        )
        stack.callback(explorer.kill)
        explored, complaints = explorer.communicate(timeout=250)
        assert explorer.returncode == 0, complaints
        learned = results(started)
        recorded, complaints = recorder.communicate(timeout=120)
    assert recorder.returncode == 0, complaints
    return json.loads(explored), learned, json.loads(recorded)


def options_of(domain: int | None) -> tuple[str, ...]:
    """The options by which a verb is in a ROS domain."""
    return () if domain is None else ("--ros", str(domain))


def replayed_session(folder: Path, in_ros: tuple[str, ...]) -> dict[str, dict[str, Any]]:
    """Replay the recording over Zenoh into the learners, and return what they say."""
    endpoint = free_endpoint()
    with ExitStack() as stack:
        started = learners(stack, ("--listen", endpoint), "replayed", folder, in_ros)
        awaited = [option for name in RULES for option in ("--await", name)]
        options = ("--as-recorded", "--connect", endpoint, *in_ros, *awaited, "--wait", 120)
        replayed = reenact("replay", "live.mcap", *options, cwd=folder)
        assert replayed.returncode == 0, replayed.stderr
        return results(started)


@pytest.mark.parametrize(
    ("motion", "samples", "domain"),
    [
        ("short", SAMPLES, None),
        pytest.param("short", SAMPLES, 5, marks=pytest.mark.campaign),
        pytest.param("eight", 64, None, marks=pytest.mark.campaign),
    ],
)
def test_live_replayed_and_offline_are_one_state(motion: str, samples: int, domain: int | None, tmp_path: Path) -> None:
    chosen = short_motion(tmp_path / "short.csv") if motion == "short" else motion
    explored, live, recorded = live_session(chosen, tmp_path, domain)
    assert explored["ticks"] == live["learner"]["ticks"] == CYCLES * (samples + 1)
    assert (recorded["gaps"], recorded["opaque"], recorded["broken"]) == ({}, {}, [])
    counts = LogReader(tmp_path / "live.mcap").counts
    assert counts[SESSION_PHASE] == CYCLES
    assert counts[SAMPLE_JOINTS] == CYCLES * (samples + 1)

    replayed = replayed_session(tmp_path, options_of(domain))
    for name in RULES:
        training = ("train", "live.mcap", "--as-recorded", "--out", "trained.npz", "--overwrite", *settings(name))
        trained = reenact_here(*training, cwd=tmp_path)
        assert trained.returncode == 0, trained.stderr
        for key in SAME:
            offline, awaited = json.loads(trained.stdout)[key], explored["consumers"][name][key]
            assert live[name][key] == replayed[name][key] == offline == awaited
        one, other = (Controller.load(tmp_path / f"{name}-{way}.npz") for way in ("live", "replayed"))
        assert one.pairs == PAIRS[name]
        assert first_difference(one, other) is None
        difference = reenact_here("diff", f"{name}-live.npz", "trained.npz", cwd=tmp_path)
        assert (difference.returncode, difference.stdout) == (0, "no divergence\n")
