"""A log of others trains: its topics are aligned, which says what was used, and come to one digest however."""

from pathlib import Path
from typing import Any

import pytest
from lab import MAPPED, MS, SECONDS, START, holed, recording, run
from sessions import write_foreign

from pipeline.alignment.aligned_log import AlignedLog
from pipeline.alignment.config import AlignmentConfig
from pipeline.robot.config import load_robot
from recorders.containers.opening import open_log
from recorders.conversion.config import ConvertConfig
from recorders.conversion.convert import convert
from recorders.messages.message_types import String
from recorders.writing.writer import LogWriter


def test_ticks_are_those_of_the_tracker(log: Path, trained: Any) -> None:
    result, noted, controller = trained(log, *MAPPED)
    assert result["ticks"] == 2 * SECONDS * 30  # learned, then evaluated
    assert "aligned to 240 ticks at the stamps of /tracker, in 1 episode" in noted
    assert "/joint_states as /sample/joint_states: 800 messages used" in noted
    account = controller.provenance["logs"][0]["alignment"]
    assert account["topics"] == {
        "/tracker": {"as": "/hand/tip/measured", "used": SECONDS * 30},
        "/joint_states": {"as": "/sample/joint_states", "used": SECONDS * 100},
    }
    assert (account["ticks"], account["episodes"], account["tolerance_ns"]) == (240, 1, 100 * MS)


def test_what_is_aligned_may_be_written_and_trained(robot: Path, trained: Any, tmp_path: Path) -> None:
    """The ticks as a log of their own come to the same digests, with the cuts between episodes."""
    log = holed(robot, tmp_path / "holed.mcap")
    options = (*MAPPED, "--tick-rate", 25, "--tolerance", "0.05")
    result, noted, _ = trained(log, *options)
    assert "in 2 episodes; 26 not made" in noted
    config = AlignmentConfig(period_ns=40 * MS, tolerance_ns=50 * MS)
    ticks = AlignedLog(
        open_log(log),
        load_robot(robot),
        config=config,
        renames={"/tracker": "/hand/tip/measured"},
        wanted=("/hand/tip/measured", "/sample/joint_states"),
    )
    attachments = {name: ticks.attachment(name) for name in ticks.attachments}
    with LogWriter(tmp_path / "ticks.mcap", manifest=ticks.manifest, attachments=attachments) as writer:
        for record in ticks:
            writer.copy(record)
    again, noted, _ = trained(tmp_path / "ticks.mcap")
    assert noted == ""
    assert {key: again[key] for key in ("digest", "stream_digest", "ticks")} == {
        key: result[key] for key in ("digest", "stream_digest", "ticks")
    }


def test_raw_joints_and_poses_out_of_an_exploration_are_aligned(
    log: Path, robot: Path, trained: Any, tmp_path: Path
) -> None:
    """A log of ours that was converted without its ticks is aligned as a lab's is, with the robot that it carries."""
    whole, raw = tmp_path / "whole.mcap", tmp_path / "raw.mcap"
    texts = load_robot(robot).toml_text, load_robot(robot).urdf_text
    attachments = {name: text.encode() for name, text in zip(("robot.toml", "robot.urdf"), texts, strict=True)}
    with LogWriter(whole, manifest={"kind": "exploration"}, attachments=attachments) as writer:
        for record in recording(robot):
            writer.copy(record)
        writer.write("/notes", String("x"), log_time_ns=START)
    convert([whole], raw, ConvertConfig(topics=frozenset(["/joint_states", "/tracker"])))
    assert trained(raw, *MAPPED)[0]["digest"] == trained(log, *MAPPED)[0]["digest"]


def test_live_takes_the_same_ticks(log: Path, trained: Any) -> None:
    """`--as-live` learns each of them once."""
    result, _, _ = trained(log, *MAPPED, "--tick-rate", 30, "--as-live")
    offline, _, _ = trained(log, *MAPPED, "--tick-rate", 30)
    assert offline["ticks"] == 2 * result["ticks"] > 400


def test_what_is_left_aside_is_reported(
    log: Path, robot: Path, trained: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The last fifth of the ticks is not learned; nor are whole logs that are named."""
    result, _, _ = trained(log, *MAPPED, "--hold-out", "0.2")
    assert (result["ticks"], result["held_out"]["samples"]) == (2 * 192, 48)
    assert 0.0 < result["held_out"]["tip_cm"] == result["held_out"]["mean_cm"] <= result["held_out"]["max_cm"]
    assert list(result["held_out"]["joints"]) == list(load_robot(robot).joints)
    assert all(0.0 <= found["mean"] <= found["max"] for found in result["held_out"]["joints"].values())
    part = write_foreign(tmp_path / "part.mcap", [r for r in recording(robot) if r.log_time_ns < START + 6 * 10**9])
    whole, _, _ = trained(part, *MAPPED, "--hold-out", log)
    without, _, _ = trained(part, *MAPPED)
    assert whole["digest"] == without["digest"] != result["digest"]
    assert whole["held_out"]["samples"] == 240
    for wrong in ("1.5", "0"):
        arguments = ("--robot", robot, "--rule", "forward-inverse", *MAPPED, "--out", tmp_path / "x.npz")
        assert run("train", log, *arguments, "--hold-out", wrong) == 2
        assert f"--hold-out: expected a share between 0 and 1, such as 0.2, or a log, found '{wrong}'" in (
            capsys.readouterr().err
        )
