"""Logs of older formats: each step on its own, and a real log of format 1."""

from pathlib import Path

import pytest

from recorders.mcap_format.manifest import FORMAT_VERSION, content_sha256, from_metadata, to_metadata
from recorders.mcap_format.migrations import UPGRADES, upgrade
from recorders.messages.topics import LEFT_TARGET, SESSION_PHASE
from recorders.reading.reader import LogReader

LOG_1 = Path(__file__).parents[1] / "logs" / "format_1.mcap"

FORMAT_1 = {
    "format_version": 1,
    "complete": True,
    "messages": 9,
    "content_sha256": "ab" * 32,
    "environment": {"python": "3.11.2", "packages": {"numpy": "2.4.6"}},
    "kind": "exploration",
    "seed": 3,
}


def test_there_is_a_step_from_every_older_version():
    assert sorted(UPGRADES) == list(range(1, FORMAT_VERSION))


@pytest.mark.parametrize("version", sorted(UPGRADES))
def test_a_step_leads_to_the_next_version_and_changes_nothing_it_was_given(version):
    given = {**FORMAT_1, "format_version": version}
    kept = dict(given)
    assert UPGRADES[version](given)["format_version"] == version + 1
    assert given == kept


def test_format_1_did_not_count_by_topic():
    assert upgrade(FORMAT_1) == {**FORMAT_1, "format_version": 2, "counts": None}


def test_the_newest_format_stays_as_it_is():
    newest = {"format_version": FORMAT_VERSION, "counts": {"/a": 1}}
    assert upgrade(newest) == newest


def test_a_manifest_is_upgraded_as_it_is_read():
    assert from_metadata(to_metadata(FORMAT_1)) == upgrade(FORMAT_1)


def test_a_log_of_format_1_reads_as_it_did():
    reader = LogReader(LOG_1)
    manifest = reader.manifest
    assert manifest["format_version"] == FORMAT_VERSION
    assert manifest["complete"] is True
    assert manifest["counts"] is None
    assert manifest["seed"] == 3
    assert manifest["messages"] == len(list(reader)) == 35
    assert manifest["content_sha256"] == content_sha256(reader)
    assert {LEFT_TARGET, SESSION_PHASE} <= reader.counts.keys()
    assert reader.attachment("robot.urdf") == b"<robot/>"
