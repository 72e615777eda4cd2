"""Times and sizes as people write them: exact, or refused in one line that names the units."""

import pytest

from recorders.errors import ConfigError
from recorders.text.quantities import MAX_TIME_NS, parse_seconds, parse_size_or_time, seconds_text


@pytest.mark.parametrize(
    ("text", "expected_ns"),
    [
        ("0", 0),
        ("0.1", 100_000_000),
        ("1790000000.123456789", 1_790_000_000_123_456_789),
        ("18446744073.709551615", MAX_TIME_NS),
        ("1e-9", 1),
        ("1e-300", 0),
        ("0.30000000000000004", 300_000_000),
        ("2.5e1", 25_000_000_000),
    ],
)
def test_seconds_are_read_to_the_nanosecond(text: str, expected_ns: int) -> None:
    assert parse_seconds(text, "--start") == expected_ns


@pytest.mark.parametrize(
    "text", ["", "soon", "nan", "inf", "-1", "-1e-9", "1e999999999", "18446744073.709551616", "1s"]
)
def test_what_is_no_time_is_refused(text: str) -> None:
    with pytest.raises(ConfigError, match=r"^--start: expected seconds from 0 to 18446744073\.709551615, such as"):
        parse_seconds(text, "--start")


@pytest.mark.parametrize("time_ns", [0, 1, 999_999_999, 1_790_000_000_123_456_789, MAX_TIME_NS])
def test_a_time_as_text_reads_back(time_ns: int) -> None:
    assert parse_seconds(seconds_text(time_ns), "time") == time_ns


@pytest.mark.parametrize(
    ("text", "size", "time_ns"),
    [
        ("50kB", 50_000, None),
        ("50KB", 50_000, None),
        ("1.5 MiB", 1_572_864, None),
        ("2GB", 2_000_000_000, None),
        ("1 gib", 2**30, None),
        ("700B", 700, None),
        ("10min", None, 600_000_000_000),
        ("0.1s", None, 100_000_000),
        ("1h", None, 3_600_000_000_000),
    ],
)
def test_sizes_and_times_are_told_by_their_units(text: str, size: int | None, time_ns: int | None) -> None:
    assert parse_size_or_time(text, "--split") == (size, time_ns)


@pytest.mark.parametrize(
    "text", ["", "50", "50 parsecs", "0MB", "0s", "-1MB", "0.4B", "1e9GB", "99999999999999999999h"]
)
def test_what_is_neither_is_refused_with_the_units(text: str) -> None:
    with pytest.raises(ConfigError, match="a size in B, kB, MB, GB, KiB, MiB or GiB, or a time in s, min or h"):
        parse_size_or_time(text, "--split")
