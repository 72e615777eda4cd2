"""What a visitor sets is taken as it came, whatever the program shows meanwhile; who may not set it sees what is so."""

import threading
from concurrent.futures import Future
from contextlib import contextmanager

import pytest
from visitor_socket import visiting, wait_for_server
from waiting import wait_until

from pipeline.browser.page.elements.visitor_input import StoredInput, VisitorInput
from pipeline.browser.page.gate import Gate
from pipeline.browser.page.panel import MotionPart
from pipeline.browser.page.record_part import RecordPart
from pipeline.browser.page.server import page_server
from pipeline.browser.session.activity import Activity
from pipeline.browser.session.controllers import Place
from pipeline.browser.session.drive import Drive, Mode
from pipeline.browser.session.play import Play
from pipeline.browser.session.recordings import Recordings
from pipeline.browser.session.robot_link import RobotLink
from pipeline.motions.motion import load_motion
from pipeline.robot.config import load_robot
from recorders.wire.keys.topic_keys import NamespaceKeys
from recorders.wire.session import SessionConfig, open_session


@pytest.fixture(scope="module")
def server():
    with page_server(Gate(), port=None, label="") as server:
        yield server


@pytest.fixture(scope="module")
def visitor(server):
    with visiting(server) as visitor:
        yield visitor


@pytest.fixture
def play(tmp_path):
    robot = load_robot("asimo")
    drive, activity = Drive(robot), Activity()
    with open_session(SessionConfig()) as session:
        place = Place(session, (), NamespaceKeys(), tmp_path, robot.hand_names)
        link, recordings = RobotLink(session, drive, keys=NamespaceKeys()), Recordings(place, drive, tmp_path)
        yield Play(drive, link, activity, None, recordings, None, ("circles", "eight"))
    activity.close()


@contextmanager
def busy_pool(server):
    """Have none of the server's threads for handlers be free while the block runs."""
    release, pool = threading.Event(), server.gui._thread_executor
    for _ in range(pool._max_workers):
        pool.submit(release.wait)
    try:
        yield
    finally:
        release.set()


def shown(server, part, *what):
    part.show(*what)
    wait_for_server(server)


def anybody(_visitor):
    return True


def nobody(_visitor):
    return False


def test_what_a_visitor_asks_for_while_the_first_motion_is_loaded_stays(play, monkeypatch):
    def load_late(name, robot):
        """Load a motion, and have a visitor hold the hands meanwhile."""
        motion = load_motion(name, robot)
        play.drive.hold()
        return motion

    monkeypatch.setattr("pipeline.browser.session.play.load_motion", load_late)
    play.begin("teacher")
    assert (play.drive.snapshot().mode, play.drive.snapshot().loop) == (Mode.HANDLES, None)


def test_a_motion_is_paused_moved_and_left_whatever_is_shown_meanwhile(server, visitor, play):
    drive, part = play.drive, MotionPart(server, play, allowed=anybody, on_sheet=lambda draws, hand: None)
    loop = drive.go_through(load_motion("eight", play.robot))
    shown(server, part, drive.snapshot())
    with busy_pool(server):
        for element, value in ((part._pause.element, True), (part._place.element, 7.5)):
            visitor.set(element, value)
            shown(server, part, drive.snapshot())
    wait_until(lambda: loop.paused and loop.at_s == 7.5)
    with busy_pool(server):
        visitor.set(part._motion.element, "Hold")
        shown(server, part, drive.snapshot())
    wait_until(lambda: drive.snapshot().mode is Mode.HANDLES)
    with busy_pool(server):
        visitor.set(part._draw.element, True)
        shown(server, part, drive.snapshot())
    wait_until(lambda: part._drawer.element.visible)


def test_the_last_motion_is_gone_on_with(server, visitor, play):
    drive, part = play.drive, MotionPart(server, play, allowed=anybody, on_sheet=lambda draws, hand: None)
    motion = load_motion("eight", play.robot)
    loop = drive.go_through(type(motion)("drawing", motion.times_s, motion.targets, closed=True))
    loop.seek(3.0)
    drive.hold()
    shown(server, part, drive.snapshot())
    assert part._motion.element.value == "Hold"
    visitor.set(part._motion.element, "drawing")
    assert drive.snapshot().mode is Mode.MOTION
    assert drive.snapshot().loop is loop
    assert loop.at_s == 3.0


def test_who_may_not_sees_what_is_so(server, visitor, play):
    part = MotionPart(server, play, allowed=nobody, on_sheet=lambda draws, hand: None)
    loop = play.drive.go_through(load_motion("eight", play.robot))
    shown(server, part, play.drive.snapshot())
    for element, value, true in (
        (part._pause.element, True, False),
        (part._place.element, 0.5, loop.at_s),
        (part._motion.element, "circles", "eight"),
        (part._draw.element, True, False),
    ):
        visitor.set(element, value)
        shown(server, part, play.drive.snapshot())
        assert element.value == true
    assert play.drive.snapshot().loop is loop
    assert not loop.paused


def test_a_log_that_is_chosen_is_played_and_the_choice_is_free_again(server, visitor, play):
    part = RecordPart(server, play, allowed=anybody)
    (play.recordings.folder / "broken.mcap").write_bytes(b"no log")
    shown(server, part)
    with busy_pool(server):
        visitor.set(part._logs.element, "broken")
        shown(server, part)
    wait_until(lambda: play.activity.failure.startswith("log broken: "))
    wait_until(lambda: not play.activity.doing)
    shown(server, part)
    wait_until(lambda: part._logs.element.value == "(choose a log)")


def test_what_takes_a_while_is_shown_until_it_is_done(server, visitor):
    work: Future[None] = Future()
    choice = server.gui.add_dropdown("Leads", ("teacher", "learned"))
    element = VisitorInput(server, choice, allowed=anybody, take=lambda name: work)
    visitor.set(choice, "learned")
    element.show(lambda: "teacher", options=("teacher", "learned"))
    wait_for_server(server)
    assert choice.value == "learned"
    work.cancel()
    element.show(lambda: "teacher", options=("teacher", "learned"))
    wait_for_server(server)
    assert choice.value == "teacher"


@pytest.mark.parametrize(("rest_s", "left"), [(3600.0, 7.0), (0.0, 1.0)])
def test_a_slider_that_is_dragged_is_left_where_it_is(server, visitor, rest_s, left):
    taken: list[float] = []
    slider = server.gui.add_slider("Place", min=0.0, max=9.0, step=1.0, initial_value=0.0)
    element = VisitorInput(server, slider, allowed=anybody, take=taken.append, rest_s=rest_s)
    visitor.set(slider, 7)
    element.show(lambda: 1.0)
    wait_for_server(server)
    assert taken == [7.0]
    assert slider.value == left


def test_a_value_is_of_the_last_visitor_who_may(server, visitor):
    leads, text = [True], server.gui.add_text("Name", "demonstration")
    element = StoredInput(server, text, allowed=lambda number: number == visitor.number and leads[0])
    visitor.set(text, "mine")
    leads[0] = False
    visitor.set(text, "not mine")
    element.show_value()
    wait_for_server(server)
    assert element.value == text.value == "mine"


def test_a_choice_that_is_gone_gives_way_to_the_first(server):
    choice = server.gui.add_dropdown("From", ("all", "log"), initial_value="log")
    element = StoredInput(server, choice, allowed=anybody)
    element.show_value(options=("all",))
    wait_for_server(server)
    assert element.value == choice.value == "all"
    assert tuple(choice.options) == ("all",)
