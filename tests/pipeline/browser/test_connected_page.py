"""The page of a robot and a controller that run already, processes of somebody else: over a connection that is cut."""

import subprocess
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest
from chromium import chromium, executable
from processes import start, wait_for_line
from proxy import Proxy
from small_inverse import taught
from visit import PANEL_ALONE, Visit, await_arrival, shown_page
from waiting import wait_until

from pipeline.browser.session.drive import Mode
from pipeline.browser.session.play import PlayConfig
from pipeline.learner.controller import Controller
from recorders.errors import LearningError
from recorders.wire.loopback import free_endpoint
from recorders.wire.session import SessionConfig, open_session

pytestmark = pytest.mark.timeout(1500)  # software WebGL on a machine that is busy with something else

NEAR_CM = 1.0
"""As far off as a controller may be that has learned from 400 postures alone."""


class Nodes:
    """Processes that meet at an endpoint, as at a router in a laboratory."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.endpoint = folder, free_endpoint()
        self._running: dict[str, subprocess.Popen[str]] = {}

    def begin(self, name: str, line: str, *arguments: object) -> None:
        """Run a verb under a name, and wait for a line of it."""
        self._running[name] = start(*arguments, "--connect", self.endpoint, cwd=self.folder)
        wait_for_line(self._running[name], line)

    def end(self, name: str) -> None:
        process = self._running.pop(name)
        process.terminate()
        process.communicate(timeout=120)

    def end_all(self) -> None:
        for name in list(self._running):
            self.end(name)

    def begin_robot(self) -> None:
        self.begin("robot", "waits for commands", "robot", "--real-time")

    def serve(self, controller: Controller, name: str) -> None:
        controller.save(self.folder / f"{name}.npz")
        self.begin(name, "serves", "serve", f"{name}.npz", "--name", name)


@pytest.fixture(scope="module")
def nodes(tmp_path_factory):
    executable()
    nodes = Nodes(tmp_path_factory.mktemp("nodes"))
    with open_session(SessionConfig(listen=(nodes.endpoint,))), ExitStack() as stack:
        stack.callback(nodes.end_all)
        nodes.begin_robot()
        nodes.serve(taught(), "ours")
        yield nodes


@pytest.fixture(scope="module")
def proxy(nodes) -> Iterator[Proxy]:
    with Proxy(nodes.endpoint) as proxy:
        yield proxy


@pytest.fixture(scope="module")
def page(nodes, proxy):
    session = SessionConfig(connect=(proxy.endpoint,))
    with shown_page(PlayConfig(session=session, folder=nodes.folder / "play", wait_s=120.0)) as page:
        yield page


@pytest.fixture(scope="module")
def visit(page):
    with chromium(*PANEL_ALONE) as browser:
        yield Visit(browser, page)


def assert_driven(page, visit, metres):
    """Drag the right hand, and wait until the robot's hand is there."""
    before = page.play.drive.snapshot().wanted[1]
    visit.drag_handle(1, metres)
    wait_until(lambda: np.linalg.norm(page.play.drive.snapshot().wanted[1] - before) > 0.5 * abs(metres))
    await_arrival(page, within_cm=NEAR_CM)


def test_a_robot_that_runs_already_is_driven_through_whoever_serves(page, visit):
    assert page.play.controllers is None
    assert page.play.drive.snapshot().mode is Mode.AT_REST
    visit.await_shown("state:robot", "nothing is asked of it")
    assert_driven(page, visit, -0.05)
    wait_until(lambda: "targets answered" in visit.shown("state:controller"))


def test_a_connected_robot_teaches_from_what_it_does_and_from_a_recording_of_it(page, visit):
    explore = visit.tab.get_by_role("button", name="Explore by itself")
    visit.tab.get_by_role("button", name="Learn").wait_for()
    assert not explore.count()  # the robot is somebody else's
    with pytest.raises(LearningError, match="reenact explore"):
        page.teaching.explore(60.0)
    page.play.go_through("eight")
    visit.tab.get_by_role("button", name="Learn").click()
    visit.tab.get_by_role("button", name="Record", exact=True).click()
    visit.await_shown("recording", "recording demonstration")
    wait_until(lambda: page.teaching.curve.last_cm is not None or page.teaching.failure)
    visit.tab.get_by_role("button", name="End the recording").click()
    visit.await_shown("recording", "cm on average")
    visit.tab.get_by_role("button", name="Finish now").click()
    assert_taught(page, visit, "forward-inverse-1")
    visit.tab.get_by_label("From").click()
    visit.tab.get_by_role("option", name="demonstration").click()
    wait_until(lambda: page._teach.source == "demonstration")
    visit.tab.get_by_role("button", name="Learn").click()
    assert_taught(page, visit, "forward-inverse-2")
    assert page.play.link.controller == ""  # whoever serves goes on
    page.play.drive.hold()


def assert_taught(page, visit, name):
    """Keep what was learned, which is a controller of this robot, and served by whoever wants it."""
    visit.await_taught(f"{name} learned")
    assert "serve it in place of the one that serves" in visit.shown("taught")
    visit.tab.get_by_role("button", name="Keep").click()
    visit.await_shown("taught", f"{name} is kept as")
    assert Controller.load(page.play.recordings.folder / f"{name}.npz").joints == page.play.robot.joints


def test_a_connection_that_is_cut_is_stated_and_comes_back(page, visit, proxy):
    proxy.cut()
    visit.await_shown("robot", "is gone")
    before = page.play.drive.snapshot().wanted[1]
    visit.drag_handle(1, 0.05)  # nobody is there to move, and it is not forgotten
    wait_until(lambda: np.linalg.norm(page.play.drive.snapshot().wanted[1] - before) > 0.03)
    wait_until(lambda: not page.scene._dragged)  # let go of, behind the last move
    wanted = page.play.drive.snapshot().wanted
    proxy.restore()
    visit.await_shown("state:robot", "asimo")
    await_arrival(page, within_cm=NEAR_CM)
    assert np.abs(page.play.drive.snapshot().wanted - wanted).max() < 1e-9
    assert_driven(page, visit, -0.05)


def test_a_controller_that_is_gone_and_one_of_another_robot_are_stated(page, visit, nodes):
    nodes.end("ours")
    visit.await_shown("controller", "no controller answers")
    visit.await_shown("waits", "No controller answers: errors count only with its commands")
    nodes.end("robot")  # a controller of another robot begins to serve only where no robot stands yet
    visit.await_shown("robot", "is gone")
    nodes.serve(of_another_robot(), "strange")
    nodes.begin_robot()
    visit.await_shown("state:robot", "asimo")
    visit.await_shown("strange", "has learned another robot")
    assert "right_elbow" in visit.shown("strange")
    nodes.end("strange")
    wait_until(lambda: not visit.shown("strange"))


def of_another_robot() -> Controller:
    """Return a controller whose robot calls an elbow by another name."""
    own = taught()
    renamed = {name: text.replace("right_elbow", "right_bend") for name, text in texts(own).items()}
    joints = tuple(joint.replace("right_elbow", "right_bend") for joint in own.joints)
    return Controller.from_learner(own.learner(), joints=joints, pairs=own.pairs, **renamed)


def texts(controller: Controller) -> dict[str, str]:
    return {"robot_toml": controller.robot_toml, "robot_urdf": controller.robot_urdf}


def test_when_the_last_visitor_goes_nothing_is_asked_of_the_robot_any_more(page, visit):
    visit.close()
    wait_until(lambda: page.play.drive.snapshot().mode is Mode.AT_REST)
