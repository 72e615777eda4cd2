"""Recordings of the page: no recorder outlives it, what cannot be an episode is not lost, and states that are none."""

import os
import signal
from pathlib import Path

import numpy as np
import pytest
from waiting import wait_until

from pipeline.browser.session.controllers import Place
from pipeline.browser.session.drive import TICK_NS, Drive
from pipeline.browser.session.play import PlayConfig, playing
from pipeline.browser.session.recordings import Recording, Recordings
from pipeline.browser.session.robot_link import RobotLink
from pipeline.deployment.verb_process import VerbProcess
from pipeline.robot.config import load_robot
from recorders.errors import LogError
from recorders.messages.message_types import JointState
from recorders.messages.topics import JOINT_STATES
from recorders.reading.reader import LogReader
from recorders.wire.keys.topic_keys import NamespaceKeys
from recorders.wire.loopback import free_endpoint
from recorders.wire.publisher import TopicPublisher
from recorders.wire.session import SessionConfig, open_session
from recorders.writing.writer import LogWriter

START_NS = 5_000_000_000


@pytest.fixture(scope="module")
def robot():
    return load_robot("asimo")


@pytest.fixture
def endpoint():
    return free_endpoint()


@pytest.fixture
def session(endpoint):
    with open_session(SessionConfig(listen=(endpoint,))) as session:
        yield session


def driven(robot):
    """Return a drive that has made its first tick."""
    drive = Drive(robot)
    drive.hold()
    assert drive.take(START_NS, robot.comfort) is not None
    return drive


def processes_at(endpoint):
    """Return the processes that have an endpoint among their arguments."""
    found = []
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            arguments = path.read_bytes().split(b"\0")
        except OSError:  # it has ended meanwhile
            continue
        if endpoint.encode() in arguments:
            found.append(int(path.parent.name))
    return found


def test_no_recorder_outlives_a_page_that_ends_while_it_begins(robot, session, endpoint, tmp_path):
    config = PlayConfig("asimo", session=SessionConfig(connect=(endpoint,)), folder=tmp_path / "out")

    def play_shortly():
        with playing(config) as play:
            play.drive.hold()
            play.drive.take(START_NS, robot.comfort)
            play.activity.do("beginning to record", lambda: play.recordings.begin("x"))
            wait_until(lambda: processes_at(endpoint))

    with pytest.raises(LogError, match="two complete ticks"):
        play_shortly()
    try:
        assert not processes_at(endpoint)
    finally:
        for pid in processes_at(endpoint):
            os.kill(pid, signal.SIGKILL)


def test_a_recorder_that_is_not_waited_for_to_the_end_is_ended(robot, session, endpoint, tmp_path):
    class Interrupted(Place):
        def await_token(self, key, process):
            begun.append(process)
            raise KeyboardInterrupt

    begun: list[VerbProcess] = []
    recordings = Recordings(
        Interrupted(session, (endpoint,), NamespaceKeys(), tmp_path, robot.hand_names), driven(robot), tmp_path
    )
    with pytest.raises(KeyboardInterrupt):
        recordings.begin("x")
    assert begun[0].status is not None
    assert recordings.under_way is None


@pytest.mark.parametrize(("verb", "reason"), [("--version", "two complete ticks"), ("nothing", "the recorder failed")])
def test_a_recording_that_makes_no_episode_is_kept_as_it_is(robot, session, endpoint, tmp_path, verb, reason):
    folder, raw = tmp_path / "out", tmp_path / "recorded_1.mcap"
    with LogWriter(raw, manifest={}) as writer:
        writer.write(JOINT_STATES, JointState(1, robot.joints, robot.comfort), log_time_ns=1)
    written = LogReader(raw).manifest
    recordings = Recordings(
        Place(session, (endpoint,), NamespaceKeys(), tmp_path, robot.hand_names), driven(robot), folder
    )
    process = VerbProcess(tmp_path, verb)
    process.wait()
    recordings.under_way = Recording("demonstration", process, raw, 0)
    with pytest.raises(LogError, match=reason) as raised:
        recordings.end()
    (kept,) = folder.iterdir()
    assert str(raised.value).endswith(f"; all that was recorded is in {kept}")
    assert LogReader(kept).manifest == written
    assert recordings.logs() == ("demonstration_raw",)


def test_only_a_log_of_the_folder_is_found(robot, session, endpoint, tmp_path):
    (tmp_path / "elsewhere.mcap").touch()
    folder = tmp_path / "out"
    folder.mkdir()
    recordings = Recordings(
        Place(session, (endpoint,), NamespaceKeys(), tmp_path, robot.hand_names), driven(robot), folder
    )
    with pytest.raises(LogError, match="expected the name of a log"):
        recordings.path("../elsewhere")
    (folder / "here.mcap").touch()
    assert recordings.path("here") == folder / "here.mcap"


@pytest.mark.parametrize(
    ("name", "begun"),
    [("../x", "x"), (".._x y", "x_y"), ("--out", "out"), (" my own ", "my_own"), ("", "demonstration")],
)
def test_a_recording_has_a_name_that_is_listed(name, begun, robot, session, endpoint, tmp_path):
    place = Place(session, (endpoint,), NamespaceKeys(), tmp_path, robot.hand_names)
    assert Recordings(place, driven(robot), tmp_path)._free(name) == begun


@pytest.mark.parametrize("name", ["../", "...", "-", "\u30c7\u30e2"])
def test_a_name_of_which_nothing_is_left_begins_no_recording(name, robot, session, endpoint, tmp_path):
    place = Place(session, (endpoint,), NamespaceKeys(), tmp_path, robot.hand_names)
    recordings = Recordings(place, driven(robot), tmp_path)
    with pytest.raises(LogError, match=r"^name: expected letters from a to z or digits, found "):
        recordings.begin(name)
    assert recordings.under_way is None
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("number", [np.nan, np.inf])
def test_a_state_that_is_not_finite_is_refused(robot, session, number, caplog):
    drive = driven(robot)
    with RobotLink(session, drive, keys=NamespaceKeys()), TopicPublisher(session) as publisher:
        for stamp_ns, q in ((1, np.full_like(robot.comfort, number)), (2, robot.comfort)):
            state = JointState(START_NS + stamp_ns * TICK_NS, robot.joints, q)
            publisher.publish(JOINT_STATES, state, log_time_ns=state.stamp_ns)
        wait_until(lambda: drive.snapshot().time_ns == START_NS + 2 * TICK_NS)
    now = drive.snapshot()
    assert now.states == 2
    assert np.isfinite(now.targets).all()
    assert "expected finite joint positions" in caplog.text
