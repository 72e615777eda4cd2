"""`view` from the command line, and `--view` on explore and serve: shown as it happens, and nothing changed by it."""

import json
import signal
from pathlib import Path

import numpy as np
from episodes import write_episode
from here import reenact_here
from processes import complaint, reenact, start
from rerun.chunk import RrdReader
from rerun_server import rerun_server, rows

from pipeline.learner.rules.reservoir.config import LearnerConfig
from pipeline.training.trainer import train
from recorders.cdr.codec import decode_as
from recorders.messages.message_types import JointState
from recorders.messages.topics import JOINT_COMMANDS, JOINT_STATES
from recorders.reading.reader import LogReader
from recorders.wire.loopback import free_endpoint
from replay.sources.schedule import Schedule

MOTION = "t,lx,ly,lz,rx,ry,rz\n" + "".join(
    f"{0.2 * k},0.32,{0.20 + 0.01 * k},0.76,0.32,-0.20,{0.76 + 0.01 * k}\n" for k in range(4)
)


def postures(log: Path, topic: str) -> np.ndarray:
    return np.array([decode_as(JointState, record.data).position for record in LogReader(log).records(topics={topic})])


def test_view_saves_from_the_command_line(tmp_path: Path) -> None:
    write_episode(tmp_path / "circles.mcap", samples=4)
    run = reenact("view", "circles.mcap", "--save", "circles.rrd", "--json", cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    assert json.loads(run.stdout) == {"shown": "circles.mcap", "samples": 5, "recording": "circles.rrd"}
    assert RrdReader(tmp_path / "circles.rrd").recordings()
    assert "expected a log or a controller" in complaint(reenact_here("view", "none.mcap", cwd=tmp_path))


def test_an_exploration_is_shown_as_it_is_recorded(tmp_path: Path) -> None:
    (tmp_path / "lift.csv").write_text(MOTION)
    options = ("explore", "--motion", "lift.csv", "--json")
    with rerun_server(tmp_path) as server:
        seen = reenact(*options, "--out", "seen.mcap", "--viewer", server.url, cwd=tmp_path)
    unseen = reenact(*options, "--out", "unseen.mcap", cwd=tmp_path)
    assert seen.returncode == unseen.returncode == 0, seen.stderr + unseen.stderr
    assert (tmp_path / "seen.mcap").read_bytes() == (tmp_path / "unseen.mcap").read_bytes()
    shown = rows(server.path, "/joints", "Scalars:scalars")
    np.testing.assert_array_equal(shown, postures(tmp_path / "seen.mcap", JOINT_STATES))


def test_what_a_controller_answers_is_shown(tmp_path: Path) -> None:
    log = write_episode(tmp_path / "circles.mcap", samples=8)
    train([log], schedule=Schedule(epochs=1), config=LearnerConfig()).controller().save(tmp_path / "x.npz")
    endpoint = free_endpoint()
    with rerun_server(tmp_path) as server:
        serve = start(
            "serve", "x.npz", "--listen", endpoint, "--record", "s.mcap", "--viewer", server.url, cwd=tmp_path
        )
        try:
            assert serve.stderr is not None
            while "serves" not in (line := serve.stderr.readline()):
                assert line, "the controller ended"
            play = ("replay", log, "--play", "--connect", endpoint, "--rate", "4")
            replay = reenact(*play, cwd=tmp_path)
            assert replay.returncode == 0, replay.stderr
            serve.send_signal(signal.SIGINT)
            _, complaints = serve.communicate(timeout=120)
        finally:
            serve.kill()
    assert "--view" not in complaints
    shown = rows(server.path, "/joints", "Scalars:scalars")
    assert len(shown) > 0
    np.testing.assert_array_equal(shown, postures(tmp_path / "s.mcap", JOINT_COMMANDS))
