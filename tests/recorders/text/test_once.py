"""A line that anybody may cause again and again is logged once, printable and bounded, and so is their number."""

import logging

import pytest

from recorders.text.once import OnceWarner

logger = logging.getLogger("recorders.text.test")


def test_each_line_is_logged_once_and_only_so_many(caplog: pytest.LogCaptureFixture) -> None:
    warnings = OnceWarner(logger, limit=2, longest=6)
    for line in ("one", "one", "a longer one", "a longer two", "\x1b[2J", "one"):
        warnings.warn(line)
    assert caplog.messages == ["one", "a long"]
    assert {record.levelname for record in caplog.records} == {"WARNING"}


def test_the_first_of_a_kind_is_logged(caplog: pytest.LogCaptureFixture) -> None:
    warnings = OnceWarner(logger, limit=2)
    for line, kind in (("left 1", "left"), ("left 2", "left"), ("right 3", "right")):
        warnings.warn(line, kind=kind)
    assert caplog.messages == ["left 1", "right 3"]


def test_control_characters_are_spelt_out(caplog: pytest.LogCaptureFixture) -> None:
    OnceWarner(logger, limit=1).warn("\x1b[2J")
    assert caplog.messages == [r"\x1b[2J"]
