"""`play` in a project whose settings are of a ROS domain: a page with its own robot has no use for it."""

from contextvars import copy_context
from pathlib import Path

import pytest
import typer

from pipeline.cli.app import app
from pipeline.cli.project_settings import SETTINGS_FILE, project_defaults
from pipeline.cli.sessions import LookingSession
from recorders.wire.keys.ros_keys import RosKeys
from recorders.wire.keys.topic_keys import NamespaceKeys, TopicKeys

RULES = ["chatter:=/lab/chatter"]


@pytest.fixture(autouse=True)
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / SETTINGS_FILE).write_text(f"ros = 0\nremap = {RULES}\n".replace("'", '"'))
    monkeypatch.chdir(tmp_path)


def test_a_domain_of_the_settings_is_for_sessions_that_are_asked_for() -> None:
    def found() -> tuple[TopicKeys, TopicKeys]:
        """Return the keys of a page without a session, and with one."""
        project_defaults(typer.main.get_command(app), ["play"])
        own, there = (LookingSession(ros=0, remap=RULES, connect=connect) for connect in (None, ["tcp/127.0.0.1:1"]))
        return own.keys("play"), there.keys("play")

    own, there = copy_context().run(found)
    assert own == NamespaceKeys()
    assert isinstance(there, RosKeys)
    assert there.domain == 0
