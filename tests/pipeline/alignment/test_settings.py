"""Settings are read to the last digit, refused beyond their ends, and written as JSON as far as they were asked for."""

import json

import pytest

from pipeline.alignment.config import (
    AlignmentConfig,
    parse_latencies,
    parse_rate,
    parse_signed_seconds,
    parse_tolerance,
    parse_transforms,
)
from recorders.errors import ConfigError

S = 10**9
POSE = (1.0, 2.0, -3.0, 0.0, 0.0, 0.0, 2.0)


@pytest.mark.parametrize(
    ("text", "period_ns"),
    [
        ("30", 33_333_333),
        ("1000", 10**6),
        ("0.001", 10**12),
        ("1e-3", 10**12),
        (" +1.5E2 ", 6_666_667),
        (".5", 2 * S),
        ("5.", S // 5),
    ],
)
def test_a_rate_is_a_period_to_the_nearest_nanosecond(text: str, period_ns: int) -> None:
    assert parse_rate(text) == period_ns


@pytest.mark.parametrize(
    "text", ["0.00099999", "1000.0001", "0", "-30", "", "nan", "inf", "1e1000", "0x10", "1_0", "٣"]
)
def test_what_is_no_rate_is_refused(text: str) -> None:
    with pytest.raises(ConfigError, match=r"--tick-rate: expected a rate from 0.001 to 1000 Hz, found '"):
        parse_rate(text)


def test_seconds_are_read_to_the_nearest_nanosecond_up_to_their_ends() -> None:
    assert parse_signed_seconds("-0.0000000014", "--x", 2) == -1
    assert parse_signed_seconds("1e-9", "--x", 1) == 1
    assert parse_tolerance("5") == 5 * S
    assert parse_latencies(["/a=-3600", "/b=3600"]) == {"/a": -3600 * S, "/b": 3600 * S}
    for text in ("5.000000001", "-5.000000001", "soon"):
        with pytest.raises(ConfigError, match="--tolerance: expected seconds within 5 of 0"):
            parse_tolerance(text)
    with pytest.raises(ConfigError, match="--latency /b: expected seconds within 3600 of 0"):
        parse_latencies(["/a=3600", "/b=3600.000000001"])


@pytest.mark.parametrize("pair", ["/a", "=1", "/a=", "", "/b=1"])
def test_a_topic_comes_once_with_its_value(pair: str) -> None:
    with pytest.raises(ConfigError, match="--latency: expected TOPIC=SECONDS, each topic once, found"):
        parse_latencies(["/b=1", pair])


def test_a_pose_is_seven_numbers_of_which_four_have_a_length() -> None:
    shortest = (0.0, 0.0, 0.0, 0.0, -1e-6, 0.0, 0.0)
    texts = [f"{topic}={','.join(map(str, pose))}" for topic, pose in (("/a", POSE), ("/b", shortest))]
    assert parse_transforms(texts, "--frame") == {"/a": POSE, "/b": shortest}
    for cells in ("1,2,3,0,0,1", "1,2,3,0,0,0,1,0", "1,2,3,0,0,0,1,x", "1,2,3,0,0,0,1e999", "1,,2,3,0,0,0,1"):
        with pytest.raises(ConfigError, match="--frame /a: expected seven numbers"):
            parse_transforms([f"/a={cells}"], "--frame")
    with pytest.raises(ConfigError, match="--frame /a: expected a quaternion with a length"):
        parse_transforms(["/a=1,2,3,9e-7,0,0,-9e-7"], "--frame")


@pytest.mark.parametrize(("tolerance_ns", "fine"), [(0, True), (5 * S, True), (-1, False), (5 * S + 1, False)])
def test_a_tolerance_is_from_0_to_5_s(tolerance_ns: int, fine: bool) -> None:
    if fine:
        assert AlignmentConfig(tolerance_ns=tolerance_ns).nearness_ns == tolerance_ns
    else:
        with pytest.raises(ConfigError, match="--tolerance: expected 0 to 5 s, found"):
            AlignmentConfig(tolerance_ns=tolerance_ns)


def test_settings_that_are_none_or_exclude_each_other_are_refused() -> None:
    with pytest.raises(ConfigError, match="--clock: expected header or log, found 'sun'"):
        AlignmentConfig(clock="sun")
    with pytest.raises(ConfigError, match="expected one of --tick-rate and --ticks-of, found both"):
        AlignmentConfig(period_ns=S, ticks_of="/a")


def test_json_has_the_tolerance_and_what_was_asked_for() -> None:
    plain = AlignmentConfig()
    assert plain.to_dict() == {"tolerance_ns": S // 10}
    assert AlignmentConfig(clock="header").to_dict() == plain.to_dict()
    poses = {"/b": POSE, "/a": POSE}
    full = AlignmentConfig(None, "/a", 7, {"/b": 1, "/a": 2}, "log", poses, {"/c": POSE})
    numbers = [*POSE]
    assert json.dumps(full.to_dict()) == json.dumps(
        {
            "ticks_of": "/a",
            "tolerance_ns": 7,
            "latencies_ns": {"/a": 2, "/b": 1},
            "clock": "log",
            "frames": {"/a": numbers, "/b": numbers},
            "offsets": {"/c": numbers},
        }
    )
    assert AlignmentConfig(period_ns=5).to_dict() == {"period_ns": 5, "tolerance_ns": S // 10}


def test_a_default_that_is_asked_for_is_asked_for() -> None:
    assert not AlignmentConfig().asks
    assert AlignmentConfig(tolerance_ns=S // 10).asks
    assert AlignmentConfig(clock="header").asks
    assert [AlignmentConfig(clock=clock).by_log_time for clock in (None, "header", "log")] == [False, False, True]
