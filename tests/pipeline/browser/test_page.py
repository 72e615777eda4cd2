"""The page in a real Chromium, with a simulated robot and a controller in processes of their own behind it."""

import os
import signal

import numpy as np
import pytest
from chromium import chromium, executable
from visit import ARRIVED_CM, PANEL_ALONE, Visit, await_arrival, shown_page
from waiting import wait_until

pytestmark = pytest.mark.timeout(1500)  # software WebGL on a machine that is busy with something else


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    from pipeline.browser.session.play import PlayConfig

    executable()
    with shown_page(PlayConfig(folder=tmp_path_factory.mktemp("play"))) as page:
        wait_until(lambda: page.play.link.controller == "teacher")
        yield page


@pytest.fixture(scope="module")
def browser():
    with chromium(*PANEL_ALONE) as browser:
        yield browser


@pytest.fixture(scope="module")
def visitor(browser, page):
    return Visit(browser, page)


@pytest.fixture(scope="module")
def phone(browser, page):
    return Visit(browser, page, on_phone=True)


@pytest.fixture
def visit(visitor, page):
    page.play.drive.hold()
    return visitor


def test_a_handle_dragged_by_10_cm_takes_the_hand_with_it(page, visit):
    await_arrival(page)
    before = page.play.drive.snapshot()
    visit.drag_handle(1, -0.10)
    wait_until(lambda: np.linalg.norm(page.play.drive.snapshot().wanted[1] - before.wanted[1]) > 0.08)
    await_arrival(page)
    moved = page.play.drive.snapshot().hands - before.hands
    assert np.linalg.norm(moved[1]) == pytest.approx(0.10, abs=0.02)
    assert np.linalg.norm(moved[0]) < 0.005
    wait_until(lambda: float(visit.shown("now:right")) < ARRIVED_CM)
    own = page.address.removeprefix("http")
    assert visit.requested
    assert all(url.startswith((f"http{own}", f"ws{own}", "blob:", "data:")) for url in visit.requested)


def test_a_stroke_is_followed_again_and_again(page, visit):
    centre, (left, up) = page.play.robot.centres[1], (page.play.robot.lateral, page.play.robot.up)
    corners = [centre + 0.08 * (a * left + b * up) for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1), (-1, -1))]
    visit.draw(1, *corners)
    wait_until(lambda: (loop := page.play.drive.snapshot().loop) is not None and loop.name == "drawing")
    loop = page.play.drive.snapshot().loop
    size = loop.path[:, 1].max(axis=0) - loop.path[:, 1].min(axis=0)
    assert abs(size @ left) == pytest.approx(0.16, abs=0.04)
    wait_until(lambda: loop.at_s > 0.5 * loop.duration_s)
    wait_until(lambda: loop.at_s < 0.2 * loop.duration_s)
    visit.tab.get_by_label("Pause").click()
    wait_until(lambda: loop.paused)


def test_one_visitor_leads_until_another_takes_over(page, visit, phone):
    assert "You lead" in visit.shown("visitor")
    assert "look on" in phone.shown("visitor")
    await_arrival(page)
    wanted = page.play.drive.snapshot().wanted
    phone.drag_handle(1, -0.05)
    refusal = phone.tab.get_by_text("Take over to lead the robot").first
    refusal.wait_for()
    wait_until(lambda: np.abs(page.scene.handle_position(1) - wanted[1]).max() < 1e-3)
    assert np.abs(page.play.drive.snapshot().wanted - wanted).max() < 1e-9
    phone.tab.get_by_role("button", name="Learn").click()
    phone.tab.get_by_role("button", name="Take over").click()
    phone.await_shown("visitor", "You lead")
    visit.await_shown("visitor", "You look on")
    refusal.wait_for(state="hidden")  # it lies over the picture
    assert page.teaching.curve is None  # what was pressed before did not begin to learn


def test_on_a_phone_a_finger_drags_and_draws(page, phone):
    before, earlier = page.play.drive.snapshot().wanted, page.play.drive.snapshot().loop
    phone.drag_handle(1, -0.05)
    wait_until(lambda: np.linalg.norm(page.play.drive.snapshot().wanted[1] - before[1]) > 0.03)
    centre, (left, up) = page.play.robot.centres[1], (page.play.robot.lateral, page.play.robot.up)
    phone.draw(1, *(centre + 0.08 * (a * left + b * up) for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1), (-1, -1))))
    wait_until(lambda: page.play.drive.snapshot().loop is not earlier and not page.play.activity.doing)
    assert page.play.drive.snapshot().loop.name == "drawing"


def test_a_tab_that_is_closed_while_it_drags_lets_go(page, visit, phone):
    await_arrival(page)
    grip = phone.grip(1)
    phone.press(grip)
    phone.move(grip - 0.05 * page.play.robot.lateral)
    wait_until(lambda: 1 in page.scene._dragged)
    phone.close()
    visit.await_shown("visitor", "You lead")
    wait_until(lambda: not page.scene._dragged)
    page.play.drive.move_hand(1, page.play.robot.centres[1])
    wait_until(lambda: np.abs(page.scene.handle_position(1) - page.play.robot.centres[1]).max() < 1e-3)


def test_a_page_that_is_loaded_again_shows_what_is_so(page, visit):
    before = set(page._server.get_clients())
    visit.tab.reload()
    visit.await_client(before)
    visit.await_shown("visitor", "You lead")
    visit.await_shown("state:robot", "asimo")
    assert float(visit.shown("now:left")) >= 0.0


def test_a_robot_that_is_killed_is_missed_and_led_again(page, visit):
    await_arrival(page)
    wanted = page.play.drive.snapshot().wanted
    os.kill(page.play.own_robot.pid, signal.SIGKILL)
    visit.await_shown("robot", "is gone")
    wait_until(lambda: page.play.link.is_there and page.play.own_robot.restarts == 1)
    visit.await_shown("state:robot", "asimo")
    await_arrival(page)
    assert np.abs(page.play.drive.snapshot().wanted - wanted).max() < 1e-9


def test_a_controller_that_is_killed_is_started_again(page, visit):
    killed = page.play.controllers.pid("teacher")
    os.kill(killed, signal.SIGKILL)
    wait_until(lambda: page.play.controllers.pid("teacher") != killed and not page.play.activity.doing)
    visit.drag_handle(1, 0.05)
    await_arrival(page)


def test_what_is_recorded_is_an_episode_with_the_figures_of_the_page(page, visit):
    from pipeline.evaluation.trials import evaluate_motion
    from pipeline.learner.registry import default_config
    from pipeline.robot.config import parse_robot
    from pipeline.training.trainer import train
    from replay.sources.schedule import Schedule

    page.play.go_through("eight")
    visit.tab.get_by_role("button", name="Record", exact=True).click()
    visit.await_shown("recording", "recording demonstration")
    begun = page.play.drive.snapshot().mean.ticks
    wait_until(lambda: page.play.drive.snapshot().mean.ticks > begun + 100)
    visit.tab.get_by_role("button", name="End the recording").click()
    visit.await_shown("recording", "cm on average")
    log = page.play.recordings.path("demonstration")
    shown = visit.shown("recording")
    robot = page.play.robot
    trainer = train([log], schedule=Schedule(epochs=1), config=default_config("forward-inverse"))
    assert parse_robot(trainer.controller().robot_toml, trainer.controller().robot_urdf).joints == robot.joints
    found = evaluate_motion(trainer.controller(), log)
    assert f"{found.errors.samples} targets, hands off by {found.teacher.mean_cm:.2f} cm" in shown
    for hand, error_cm in found.teacher.hands_cm.items():
        assert f"{hand} {error_cm:.2f}" in shown
    page.play.go_through_log("demonstration")
    assert page.play.drive.snapshot().loop.duration_s >= 2.0
    wait_until(lambda: page.play.drive.snapshot().loop.at_s > 0.5)


def test_what_was_recorded_teaches_a_controller_that_leads_until_it_is_undone(page, visit):
    wait_until(page.play.recordings.logs)  # of the test before
    visit.tab.get_by_label("From").click()
    visit.tab.get_by_role("option", name="all recordings").click()
    wait_until(lambda: page._teach.source == "all recordings")
    visit.tab.get_by_role("button", name="Learn").click()
    visit.await_taught("forward-inverse-1 learned")
    wait_until(lambda: page.play.link.controller == "forward-inverse-1" and not page.play.activity.doing)
    answered = page.play.link.controller_status().get("answered", 0)
    wait_until(lambda: page.play.link.controller_status().get("answered", 0) > answered)
    page.play.go_through("eight")
    visit.await_shown("rounds", "eight")
    wait_until(lambda: not visit.shown("driven:forward-inverse-1").startswith("0"))
    assert float(visit.shown("left:forward-inverse-1").split(" / ")[0]) >= 0.0
    visit.tab.get_by_role("button", name="Undo").click()
    visit.await_shown("taught", "is undone")
    wait_until(lambda: page.play.link.controller == "teacher" and page.play.controllers.names == ("teacher",))


def test_a_controller_that_explored_by_itself_leads_and_is_kept(page, visit):
    visit.tab.get_by_role("button", name="Explore by itself").click()
    visit.await_shown("state:robot", "exploring by itself")
    wait_until(lambda: "cm off" in visit.shown("lesson") or page.teaching.failure)
    assert "exploring by itself for 60 s" in visit.shown("lesson")
    visit.tab.get_by_role("button", name="Finish now").click()
    visit.await_taught("self-taught-2 learned")
    wait_until(lambda: page.play.link.controller == "self-taught-2" and not page.play.activity.doing)
    visit.tab.get_by_role("button", name="Keep").click()
    visit.await_shown("taught", "is kept as")
    assert (page.play.recordings.folder / "self-taught-2.npz").is_file()
