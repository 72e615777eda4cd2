"""Lessons behind the page, with a simulated robot: what is learned leads at once, and is kept, undone or given up."""

import shutil

import pytest
from waiting import wait_until

from pipeline.browser.session.drive import Mode
from pipeline.browser.session.play import FIRST_MOTION, PlayConfig, playing
from pipeline.browser.teaching.teaching import Teaching
from pipeline.cli.project_settings import SETTINGS_FILE
from pipeline.evaluation.trials import evaluate_motion
from pipeline.learner.controller import Controller
from pipeline.resources import data_path
from recorders.errors import LearningError, LogError

VOLUME = data_path("golden", "forward_inverse", "volume_50.mcap")


@pytest.fixture(scope="module")
def play(tmp_path_factory):
    """A page with a robot of its own, in a project whose settings are of a ROS domain: it has no use for it."""
    folder = tmp_path_factory.mktemp("play")
    (folder / SETTINGS_FILE).write_text('ros = 0\nremap = ["chatter:=/lab/chatter"]\n')
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        with playing(PlayConfig(folder=folder / "out")) as play:
            await_leading(play, "teacher")
            assert play.drive.snapshot().loop.name == FIRST_MOTION  # by itself, once somebody leads
            yield play


@pytest.fixture
def teaching(play):
    teaching = Teaching(play)
    play.drive.hold()
    yield teaching
    teaching.close()
    assert teaching.lesson is None


def await_end(teaching):
    wait_until(lambda: teaching.lesson is None)


def await_leading(play, name):
    wait_until(lambda: play.link.controller == name and not play.activity.doing)


def await_answers(play):
    """Wait until the controller that leads answers targets."""
    before = play.link.controller_status().get("answered", 0)
    wait_until(lambda: play.link.controller_status().get("answered", 0) > before)


def test_the_robot_of_a_page_is_moved_whatever_domain_the_settings_name(play):
    await_answers(play)
    play.go_through("circles")
    before = play.drive.snapshot().q
    wait_until(lambda: abs(play.drive.snapshot().q - before).max() > 0.01)


def test_nothing_teaches_nothing(play, teaching):
    with pytest.raises(LearningError, match="found none: record one"):
        teaching.learn("reservoir", ())
    with pytest.raises(LogError, match="expected the name of a log"):
        teaching.learn("reservoir", ("../elsewhere",))
    play.drive.rest()
    with pytest.raises(LearningError, match="choose a motion"):
        teaching.learn_live("reservoir")
    for ask in (teaching.undo, lambda: teaching.keep("name")):
        with pytest.raises(LearningError, match="just learned, found none"):
            ask()


@pytest.mark.parametrize("rule", ["x\0y", "../../esc", "", "-", "Reservoir", "r" * 10**6])
def test_a_rule_that_the_page_does_not_teach_begins_nothing(rule, play, teaching):
    for ask in (lambda: teaching.learn(rule, ()), lambda: teaching.learn_live(rule)):
        with pytest.raises(LearningError, match=r"^rule: expected one of .*reservoir.*found '.{0,60}$"):
            ask()
    assert teaching.lesson is None


@pytest.mark.parametrize("seconds", [4.9, 600.1, -1, 0, float("nan"), float("inf"), 10**400])
def test_a_time_that_the_page_does_not_offer_begins_no_exploration(seconds, play, teaching):
    with pytest.raises(LearningError, match=r"^expected 5 to 600 s to explore, found .{1,60}$"):
        teaching.explore(seconds)
    assert teaching.lesson is None
    assert play.drive.snapshot().mode is Mode.HANDLES


def test_what_a_log_teaches_leads_and_is_kept_under_a_name(play, teaching):
    folder = play.recordings.folder
    folder.mkdir()
    shutil.copyfile(VOLUME, folder / "volume.mcap")
    teaching.learn("forward-inverse", ("volume",))
    with pytest.raises(LearningError, match="learning forward-inverse from volume is not done yet"):
        teaching.learn("reservoir", ("volume",))
    with pytest.raises(LearningError, match="is not done yet"):
        teaching.explore(5.0)
    await_end(teaching)
    assert teaching.failure == ""
    await_leading(play, "forward-inverse-1")
    await_answers(play)
    assert teaching.curve.last_at == 2.0
    (folder / "my_own.npz").write_bytes(b"somebody else's")
    kept = teaching.keep(" my own ")
    assert kept == folder / "my_own_2.npz"
    assert (folder / "my_own.npz").read_bytes() == b"somebody else's"
    assert str(kept) in teaching.line
    assert evaluate_motion(Controller.load(kept), VOLUME).errors.mean_cm < 0.1
    assert teaching.taught is None
    assert "forward-inverse-1" in play.controllers.names


def test_what_was_learned_live_is_undone(play, teaching):
    before = play.link.controller
    play.go_through("eight")
    teaching.learn_live("forward-inverse")
    wait_until(lambda: teaching.curve.last_cm is not None or teaching.failure)
    assert teaching.curve.unit == "passes"
    teaching.finish()
    await_end(teaching)
    assert teaching.failure == ""
    name = teaching.taught.name
    await_leading(play, name)
    teaching.undo()
    await_leading(play, before)
    wait_until(lambda: name not in play.controllers.names)
    assert name not in play.drive.rounds()
    await_answers(play)


def test_an_exploration_that_is_cancelled_gives_the_robot_back(play, teaching):
    names = play.controllers.names
    teaching.explore(600.0)
    assert play.drive.snapshot().mode is Mode.LENT
    wait_until(lambda: teaching.curve.last_cm is not None or teaching.failure)
    teaching.cancel()
    await_end(teaching)
    assert teaching.failure == "exploring by itself for 600 s: cancelled"
    assert teaching.taught is None
    assert play.controllers.names == names
    assert play.drive.snapshot().mode is Mode.HANDLES
    await_answers(play)


def test_a_log_that_teaches_nothing_is_named_in_a_line(play, teaching):
    (play.recordings.folder / "broken.mcap").write_bytes(b"no log")
    teaching.learn("reservoir", ("broken",))
    await_end(teaching)
    assert teaching.failure.startswith("learning reservoir from broken: ")
    assert "broken.mcap" in teaching.failure
    assert "\n" not in teaching.failure
    assert teaching.taught is None
