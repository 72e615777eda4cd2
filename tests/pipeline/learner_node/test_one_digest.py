"""A live session, its recording replayed, and its recording trained from the file are one learner, to the last bit."""

import json
from contextlib import ExitStack
from pathlib import Path
from subprocess import Popen
from typing import Any

import numpy as np
import pytest
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


def live_session(motion: str | Path, folder: Path) -> tuple[dict[str, Any], dict[str, Any], dict[str, Any]]:
    """Run robot, learner, recorder and explorer, each in a process of its own; return what the last three say."""
    endpoint = free_endpoint()
    with ExitStack() as stack:

        def run(*arguments: object) -> Popen[str]:
            process = stack.enter_context(start(*arguments, cwd=folder))
            stack.callback(process.kill)
            return process

        robot = run("robot", "--listen", endpoint)
        learner = run("learn", "--connect", endpoint, "--out", "live.npz", "--seed", 5, "--json")
        recorder = run("record", "--connect", endpoint, "--out", "live.mcap", "--stop-at-stream-end", "--json")
        wait_for_line(robot, "waits for commands")
        wait_for_line(learner, "waits for a replay")
        wait_for_line(recorder, "records reenact/**")
        explorer = stack.enter_context(
            spawn(
                "explore",
                connect=endpoint,
                motion=str(motion),
                seed=3,
                phases=PHASES,
                settle_ns=SETTLE_NS,
                consumers=["learner", "recorder"],
            )
        )
        stack.callback(explorer.kill)
        explored, complaints = explorer.communicate(timeout=250)
        assert explorer.returncode == 0, complaints
        (learned, _), (recorded, complaints) = learner.communicate(timeout=60), recorder.communicate(timeout=60)
    assert (learner.returncode, recorder.returncode) == (0, 0), complaints
    return json.loads(explored), json.loads(learned), json.loads(recorded)


def replayed_session(folder: Path) -> dict[str, Any]:
    """Replay the recording over Zenoh into a learner, and return what it says."""
    endpoint = free_endpoint()
    with start("learn", "--listen", endpoint, "--out", "replayed.npz", "--seed", 5, "--json", cwd=folder) as learner:
        wait_for_line(learner, "waits for a replay")
        replayed = reenact("replay", "live.mcap", "--as-recorded", "--connect", endpoint, "--json", cwd=folder)
        learned, complaints = learner.communicate(timeout=60)
    assert (replayed.returncode, learner.returncode) == (0, 0), replayed.stderr + complaints
    return dict(json.loads(learned))


@pytest.mark.parametrize(
    ("motion", "samples"), [("short", SAMPLES), pytest.param("eight", 64, marks=pytest.mark.campaign)]
)
def test_live_replayed_and_offline_are_one_state(motion: str, samples: int, tmp_path: Path) -> None:
    chosen = short_motion(tmp_path / "short.csv") if motion == "short" else motion
    explored, live, recorded = live_session(chosen, tmp_path)
    assert explored["ticks"] == live["ticks"] == CYCLES * (samples + 1)
    assert (recorded["gaps"], recorded["opaque"], recorded["broken"]) == ({}, {}, [])
    counts = LogReader(tmp_path / "live.mcap").counts
    assert counts[SESSION_PHASE] == CYCLES
    assert counts[SAMPLE_JOINTS] == CYCLES * (samples + 1)

    replayed = replayed_session(tmp_path)
    training = ("train", "live.mcap", "--as-recorded", "--out", "trained.npz", "--seed", 5, "--json")
    trained = reenact(*training, cwd=tmp_path)
    assert trained.returncode == 0, trained.stderr
    for key in SAME:
        assert live[key] == replayed[key] == json.loads(trained.stdout)[key] == explored["consumers"]["learner"][key]
    assert first_difference(*(Controller.load(tmp_path / name) for name in ("live.npz", "replayed.npz"))) is None
    difference = reenact("diff", "live.npz", "trained.npz", cwd=tmp_path)
    assert (difference.returncode, difference.stdout) == (0, "no divergence\n")
